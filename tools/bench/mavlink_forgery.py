"""Commands that nobody was entitled to give, at a real base over UDP and TCP: how many it acts on, how many it counts.

    python -m tools.bench.mavlink_forgery [--count 200]        exit code 1 if one was acted on, or one was not counted

At last the base is killed and started again, and what it obeyed before is said once more.
"""

import argparse
import random
import sys
import tempfile
from pathlib import Path

from tools.doubles.forger import attacks, trial


def run(folder: Path, count: int, seed: int) -> int:
    """All attacks; how many rows of the table are not as they should be."""
    chance = random.Random(seed)
    with trial(folder) as one:
        print(f"{'attack':34} {'way':4} {'sent':>6} {'acted':>6} {'refused':>8}  {'honest':6} as counted")
        for name, forge in attacks(chance).items():
            one.attack(name, count, forge)
        one.attack("replayed, on either line", count, lambda _: chance.choice(one.obeyed))
        one.restart()
        one.attack("replayed after a restart", count, lambda _: chance.choice(one.obeyed))
        return one.failures


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="commands of each attack on each endpoint")
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    print(f"seed {options.seed}")
    with tempfile.TemporaryDirectory() as folder:
        failures = run(Path(folder), options.count, options.seed)
    print("asked: 0 acted on, each refused and counted, the operator obeyed after each attack")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
