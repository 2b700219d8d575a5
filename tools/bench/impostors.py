"""Impostors at a real site with the production profile: how many messages get in, are believed, and are counted.

    python -m tools.bench.impostors [--count 500]       needs root, for network namespaces; exit code 1 if any harms

Three boxes and a base track a flight while one intruder after the other dials the base (tools/doubles/impostors.py).
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tools.doubles.air import Air, possible
from tools.doubles.impostors import trial
from tools.doubles.site import CAMERAS, Site, demo_flight


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=500, help="messages of each impostor")
    options = parser.parse_args()
    if reason := possible():
        print(reason, file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as temporary, Air("base", "evil", *CAMERAS) as air:
        site = Site(air, Path(temporary), demo_flight(Path(temporary) / "flight"), secure=True)
        print("{:34} {:>6} {:>9} {:>12} {:>8}".format("impostor", "said", "admitted", "disbelieved", "refused"))
        try:
            rows, honest, count = trial(site, options.count)
        finally:
            site.bury()
    print("asked: none believed (admitted = disbelieved), and all counted")
    print(f"positions meanwhile: {count}, {honest:.1%} within 99.9 % of what they claim")
    return 0 if all(row.harmless for row in rows) and honest > 0.99 else 1


if __name__ == "__main__":
    sys.exit(main())
