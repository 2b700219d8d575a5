"""What the live tracker makes of flights and boxes that are not calm or not good, kind by kind.

    python -m tools.bench.tracking_kinds [--seeds 10] [--first 0] [--kinds "4 g,late"]

Ten times a second, from two seconds on: RMSE; NEES of position (3 is true) and the share beyond its 99.9 % bound; the
share of objects that two cameras see and no target is near; how many objects got a second number; false targets; and
after how long the last object of a scene was one. Nothing here is the tracker's own model of motion.
"""

import argparse

from tools.doubles.tracker_kinds import KINDS
from tools.doubles.tracker_scores import HEAD, score


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="scenes of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--kinds", default="", help="only these, by parts of their names")
    options = parser.parse_args()
    print(f"seeds {options.first} to {options.first + options.seeds - 1}\n{HEAD}")
    for kind in KINDS:
        if any(part.strip() in kind.name for part in options.kinds.split(",")):
            print(score(kind, range(options.first, options.first + options.seeds)).row(kind.name), flush=True)


if __name__ == "__main__":
    main()
