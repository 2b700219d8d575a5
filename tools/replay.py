"""`python -m tools.replay` is `base-station replay`, for a checkout."""

import sys

from calib.station.app import main

if __name__ == "__main__":
    sys.exit(main(["replay", *sys.argv[1:]]))
