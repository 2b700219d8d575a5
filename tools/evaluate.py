"""`python -m tools.evaluate` is `base-station score`, for a checkout."""

import sys

from calib.station.app import main

if __name__ == "__main__":
    sys.exit(main(["score", *sys.argv[1:]]))
