"""What one camera that lies can do: share of positions beyond what they claim, who was named, how soon.

    python -m tools.bench.liars [--cameras 3 4 6] [--seeds 2] [--lies FIX,FOCAL] [--jobs 2]

Each scene is a site that calibrates itself with the real solver, in virtual time, and one lie (tools/doubles/liars.py).
"beyond" is the share of positions outside the 99.9 % ellipsoid that is sent with them, from five seconds of the lie on;
of an honest site it is one in a thousand. "whole": the same of what was sent without a mark, three cameras or more
agreeing about it. Exit code 1 if somebody honest was named.
"""

import argparse
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from typing import Any

import numpy as np

from calib.scoring.consistency import CHI2_3_999
from tools.doubles.liars import LIES
from tools.doubles.lying_site import Outcome, run


def _one(case: tuple[int, int, int]) -> Outcome:
    which, cameras, seed = case
    return run(LIES[which], cameras, seed)


def table(outcomes: Iterable[Outcome]) -> Iterable[str]:
    """One row a lie and number of cameras, over all seeds."""
    head = f"{'lie':40} {'cams':>4} {'sent':>6} {'error m':>8} {'sigma m':>8} {'beyond':>7} {'whole':>7}"
    yield f"{head}  named after s; at the end"
    groups: dict[tuple[str, int], list[Outcome]] = {}
    for one in outcomes:
        groups.setdefault((one.lie, one.cameras), []).append(one)
    for (lie, cameras), own in groups.items():
        errors = [error for one in own for error in one.errors_m]
        sigmas = [sigma for one in own for sigma in one.sigmas_m]
        nees = np.array([nees for one in own for nees in one.nees])
        named = "; ".join(
            sorted({f"{camera} {after:.0f}" for one in own for camera, after in (one.named or {}).items()})
        )
        median = (
            f"{np.median(errors):8.2f} {np.median(sigmas):8.2f} {np.mean(nees > CHI2_3_999):7.1%}" if errors else ""
        )
        whole = np.array([nees for one in own for nees in one.whole])
        marked = f"{np.mean(whole > CHI2_3_999):7.1%}" if len(whole) else ""
        yield f"{lie:40} {cameras:4} {len(errors):6} {median:>25} {marked:>7}  {named or '-'}; {own[-1].said[:80]}"


def main(arguments: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, nargs="+", default=[3, 4, 6])
    parser.add_argument("--seeds", type=int, default=1, help="scenes for each lie")
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--lies", default="", help="only these, by parts of their names")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    options: Any = parser.parse_args(arguments)
    parts = [part for part in options.lies.lower().split(",") if part]
    chosen = [k for k, lie in enumerate(LIES) if not parts or any(part in lie.name.lower() for part in parts)]
    cases = list(product(chosen, options.cameras, range(options.first, options.first + options.seeds)))
    began = time.monotonic()
    with ProcessPoolExecutor(options.jobs) as pool:
        outcomes = list(pool.map(_one, cases))
    for line in table(outcomes):
        print(line)
    innocents = [one for one in outcomes if one.innocents]
    worst = max(outcomes, key=lambda one: one.beyond)
    print(f"\n{len(outcomes)} scenes from seed {options.first} in {time.monotonic() - began:.0f} s")
    print(f"beyond, worst: {worst.beyond:.1%} ({worst.lie}, {worst.cameras} cameras, seed {worst.seed}); asked < 1 %")
    for cameras in options.cameras:
        nees = np.array([nees for one in outcomes if one.cameras == cameras for nees in one.nees])
        whole = np.array([nees for one in outcomes if one.cameras == cameras for nees in one.whole])
        print(
            f"beyond, all lies, {cameras} cameras: {np.mean(nees > CHI2_3_999):.2%} of {len(nees)}, "
            f"of what is sent as whole {np.mean(whole > CHI2_3_999):.2%} of {len(whole)}"
        )
    print(
        f"honest cameras named: {len(innocents)} scenes {[(one.lie, one.cameras, one.innocents) for one in innocents]}"
    )
    return int(bool(innocents))


if __name__ == "__main__":
    sys.exit(main())
