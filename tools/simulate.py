"""`python -m tools.simulate` is `base-station simulate`, for a checkout."""

import sys

from calib.station.app import main

if __name__ == "__main__":
    sys.exit(main(["simulate", *sys.argv[1:]]))
