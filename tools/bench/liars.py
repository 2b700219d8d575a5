"""What one camera that lies can do: share of positions beyond what they claim, who was named, how soon.

    python -m tools.bench.liars [--cameras 3 4 6] [--seeds 2] [--lies FIX,FOCAL] [--jobs 2] [--rows FILE]

Each scene is a site that calibrates itself with the real solver, in virtual time, and one lie (tools/doubles/liars.py).
"beyond" is the share of positions outside the 99.9 % ellipsoid that is sent with them, from five seconds of the lie on;
of an honest site it is one in a thousand. "whole": the same of what was sent without a mark, three cameras or more
agreeing about it. A scene takes the better part of a minute: `--rows` keeps what came of each, and the same call
later goes on where it was ended. Exit code 1 if somebody honest was named.
"""

import argparse
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from calib.scoring.consistency import CHI2_3_999
from tools.doubles.liars import LIES
from tools.doubles.lying_site import Outcome, run

Case = tuple[int, int, int]  # which of LIES, cameras, seed


def _one(case: Case) -> Outcome:
    which, cameras, seed = case
    return run(LIES[which], cameras, seed)


def _name(case: Case) -> tuple[str, int, int]:
    which, cameras, seed = case
    return LIES[which].name, cameras, seed


def kept(rows: Path | None) -> dict[tuple[str, int, int], Outcome]:
    """What an earlier call came to, by lie, cameras and seed; a last line that was cut off is none."""
    if rows is None or not rows.exists():
        return {}
    whole = [line for line in rows.read_bytes().splitlines(keepends=True) if line.endswith(b"\n")]
    outcomes = [msgspec.json.decode(line, type=Outcome) for line in whole]
    return {(one.lie, one.cameras, one.seed): one for one in outcomes}


def each(cases: list[Case], jobs: int, rows: Path | None) -> Iterator[Outcome]:
    """Run scenes, in whatever order they end; each is appended to `rows` and printed as it does."""
    with ProcessPoolExecutor(jobs) as pool:
        for done in as_completed([pool.submit(_one, case) for case in cases]):
            one = done.result()
            if rows is not None:
                with rows.open("ab") as file:
                    file.write(msgspec.json.encode(one) + b"\n")
            print(list(table([one]))[1], flush=True)
            yield one


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


def _share(nees: list[float]) -> str:
    return f"{np.mean(np.array(nees) > CHI2_3_999):.2%} of {len(nees)}" if nees else "none"


def main(arguments: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, nargs="+", default=[3, 4, 6])
    parser.add_argument("--seeds", type=int, default=1, help="scenes for each lie")
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--lies", default="", help="only these, by parts of their names")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--rows", type=Path, help="file to which what came of each scene is added, and read from")
    options: Any = parser.parse_args(arguments)
    parts = [part for part in options.lies.lower().split(",") if part]
    chosen = [k for k, lie in enumerate(LIES) if not parts or any(part in lie.name.lower() for part in parts)]
    cases = list(product(chosen, options.cameras, range(options.first, options.first + options.seeds)))
    began = time.monotonic()
    found = kept(options.rows)
    missing = [case for case in cases if _name(case) not in found]
    found |= {(one.lie, one.cameras, one.seed): one for one in each(missing, options.jobs, options.rows)}
    outcomes = [found[_name(case)] for case in cases]
    print()
    for line in table(outcomes):
        print(line)
    innocents = [one for one in outcomes if one.innocents]
    worst = max(outcomes, key=lambda one: one.beyond)
    print(f"\n{len(outcomes)} scenes from seed {options.first} in {time.monotonic() - began:.0f} s")
    print(f"beyond, worst: {worst.beyond:.1%} ({worst.lie}, {worst.cameras} cameras, seed {worst.seed}); asked < 1 %")
    for cameras in options.cameras:
        sent = [nees for one in outcomes if one.cameras == cameras for nees in one.nees]
        whole = [nees for one in outcomes if one.cameras == cameras for nees in one.whole]
        print(f"beyond, all lies, {cameras} cameras: {_share(sent)}, of what is sent as whole {_share(whole)}")
    print(
        f"honest cameras named: {len(innocents)} scenes {[(one.lie, one.cameras, one.innocents) for one in innocents]}"
    )
    return int(bool(innocents))


if __name__ == "__main__":
    sys.exit(main())
