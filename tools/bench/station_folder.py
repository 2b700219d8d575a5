"""A track folder through the station's core, as it would be live: time to first position, and the live error.

`python -m tools.bench.station_folder ../shared/data/eth3 --to 300`. The real solver runs on the windows the station
asks for; its answer comes back after as many seconds of the recording as `--solve-s` says, or as it really took.
"""

import argparse
import time
from collections import Counter
from pathlib import Path

import numpy as np

from calib.reference_frame import ReferenceFrame
from calib.scoring.timing import Path as Track
from calib.scoring.trajectory import evaluate
from calib.station.archive.replay_source import ReplaySource, open_source
from calib.station.commands.score import read_truth
from calib.station.config import BaseConfig, SiteSection
from calib.station.core.jobs import SolveJob, SolveResult
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from calib.station.core.surveyed_site import SurveyedSite
from calib.station.live_solver import solve_live
from edge.common.errors import SkyfixError
from edge.messages import camera_key

NS = 10**9
LATENCY_NS = 50_000_000  # of every message


def messages(source: ReplaySource, end_s: float) -> list[tuple[int, str, bytes]]:
    """(arrival, key, payload) of the folder's rows as boxes would send them; positions are the survey's alone."""
    said = [one for one in source.messages(epoch=1) if one.topic != "fix"]
    end_ns = said[0].t_ns + end_s * NS
    return [
        (one.t_ns + LATENCY_NS, camera_key(source.site, one.camera, one.topic), one.payload)
        for one in said
        if one.t_ns <= end_ns
    ]


def station_for(site: SurveyedSite) -> Station:
    """A station configured with the folder's survey."""
    sections = site.cameras
    section = SiteSection(name=site.name, origin=site.origin)
    frames = dict.fromkeys(sections, ReferenceFrame("the folder's own"))
    return Station(BaseConfig(site=section, camera=list(sections.values())), sections, StoredState(), frames=frames)


def play(source: ReplaySource, site: SurveyedSite, end_s: float, solve_s: float | None) -> np.ndarray:
    """(N, 6) seconds, position and one sigma's norm and cameras, of every target sent; prints what happens."""
    station, rows, due = station_for(site), [], None
    stream = messages(source, end_s)
    start = stream[0][0]
    told, frame_ms = "", []
    for arrival, key, payload in stream:
        began = time.perf_counter()
        sent = station.handle(key, payload, arrival)
        tick = station.tick(arrival)
        frame_ms.append((time.perf_counter() - began) * 1e3)
        at_s = (arrival - start) / NS
        rows += [((t.t_unix_ns - start) / NS, *t.position_enu, t.sigma_m, len(t.cameras)) for t in sent]
        if tick.job is not None:
            done = _solve(tick.job)
            due = (at_s + (done.seconds if solve_s is None else solve_s), done)
        if due is not None and at_s >= due[0]:
            station.solved(due[1])
            left = due[1].solved.left_out if due[1].solved is not None else ()
            what = due[1].error or ", ".join(f"{camera} left out: {why}" for camera, why in left)
            print(f"{at_s:7.1f} s  solved in {due[1].seconds:.1f} s: {what}")
            due = None
        if (station.standing.reason != told and not told.startswith("waiting for an object")) or (
            sent and len(rows) == 1
        ):
            print(f"{at_s:7.1f} s  {station.standing.phase}: {station.standing.reason}")
        told = station.standing.reason
    print(f"ms a message: median {np.median(frame_ms):.2f}, 99 % {np.percentile(frame_ms, 99):.2f}")
    print("tracker", dict(station.tracker.counters) if station.tracker else None, Counter(station.counters))
    return np.array(rows)


def _solve(job: SolveJob) -> SolveResult:
    began = time.monotonic()
    try:
        return SolveResult(job.number, solve_live(job.scene, job.start), None, time.monotonic() - began)
    except SkyfixError as error:
        return SolveResult(job.number, None, error, time.monotonic() - began)


def main() -> None:
    """Play and score."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--to", type=float, default=1e9, help="seconds of the recording")
    parser.add_argument(
        "--solve-s", type=float, help="seconds of the recording that a solve takes; default: as it took"
    )
    options = parser.parse_args()
    source = open_source(options.folder)
    if source.folder is None:
        parser.error(f"{options.folder} is no track folder")
    live = play(source, source.folder.site, options.to, options.solve_s)
    if not len(live):
        print("nothing was sent")
        return
    sigma_m = np.median(live[:, 4])
    print(f"first position {live[0, 0]:.1f} s after the first row; {len(live)} sent; median sigma {sigma_m:.2f} m")
    truth_file = options.folder / "truth.csv"
    if truth_file.exists():
        truth = read_truth(truth_file)
        for name, sent in (("all", live), ("seen by 2 or more", live[live[:, 5] >= 2])):
            _, first_of_instant = np.unique(sent[:, 0], return_index=True)
            found = evaluate(Track(sent[first_of_instant, 0], sent[first_of_instant, 1:4]), truth, "yaw", "shift")
            print(
                f"{name}: yaw-aligned RMSE {found.rmse_m:.3f} m "
                f"(clock {found.shift_s:.2f} s, yaw {found.yaw_deg:.2f} deg)"
            )


if __name__ == "__main__":
    main()
