"""A track folder through the station's core, as it would be live: time to first position, and the live error.

`python -m tools.bench.station_folder ../shared/data/eth3 --to 300`. The real solver runs on the windows the station
asks for; its answer comes back after as many seconds of the recording as `--solve-s` says, or as it really took.
"""

import argparse
import csv
import time
from collections import Counter
from pathlib import Path

import numpy as np

from calib.geodesy import enu_to_geodetic
from calib.observations import Scene, SiteCamera
from calib.station.archive.replay_source import play_back
from calib.station.config import BaseConfig, CameraSection, SiteSection
from calib.station.core.jobs import SolveJob, SolveResult
from calib.station.core.station import Station
from calib.station.core.stored_state import StoredState
from calib.station.live_solver import solve_live
from edge.common.errors import SkyfixError
from edge.messages import Detection, Lens, Tracks, camera_key, encode

NS = 10**9
LATENCY_NS = 50_000_000  # of every message


def messages(scene: Scene, end_s: float) -> list[tuple[int, str, bytes]]:
    """(arrival, key, payload) of the folder's rows as boxes would send them."""
    cameras = {camera.id: camera for camera in scene.cameras}
    first = min(int(seen.t_unix_ns[0]) for seen in scene.observations.values())
    made = [(first, camera_key(scene.site, c.id, "lens"), encode(_lens(c))) for c in scene.cameras]
    for name, seen in scene.observations.items():
        for seq, (stamp, (u, v), track) in enumerate(zip(seen.t_unix_ns, seen.pixels, seen.track, strict=True)):
            if stamp > first + end_s * NS:
                break
            tracks = _tracks(cameras[name], int(stamp), seq, (float(u), float(v)), max(int(track), 1))
            made.append((int(stamp) + LATENCY_NS, camera_key(scene.site, name, "tracks"), encode(tracks)))
    return sorted(made, key=lambda message: message[0])


def _lens(camera: SiteCamera) -> Lens:
    return Lens.of(camera.lens)


def _tracks(camera: SiteCamera, stamp: int, seq: int, pixel: tuple[float, float], track: int) -> Tracks:
    detection = Detection(
        track=track,
        u_px=pixel[0],
        v_px=pixel[1],
        ray_x=0.0,
        ray_y=0.0,
        width_px=10.0,
        height_px=10.0,
        score=1.0,
        status="confirmed",
    )
    return Tracks(
        t_unix_ns=stamp,
        seq=seq,
        epoch=1,
        clock_bound_s=camera.clock_bound_s,
        size_px=camera.lens.size_px,
        readout_s=0.0,
        detections=[detection],
    )


def station_for(scene: Scene) -> Station:
    """A station configured with the folder's survey."""
    sections = []
    for camera in scene.cameras:
        if camera.position_enu is None or camera.position_covariance is None:
            sections.append(CameraSection(id=camera.id))
            continue
        latitude, longitude, height = enu_to_geodetic(camera.position_enu[None], scene.origin)[0].tolist()
        east, north, up = np.sqrt(np.diag(camera.position_covariance)).tolist()
        place = (latitude, longitude, height)
        sections.append(CameraSection(id=camera.id, position=place, position_sigma=(east, north, up)))
    config = BaseConfig(site=SiteSection(name=scene.site, origin=scene.origin), camera=sections)
    return Station(config, {section.id: section for section in sections}, StoredState())


def play(scene: Scene, end_s: float, solve_s: float | None) -> np.ndarray:
    """(N, 6) seconds, position and one sigma's norm and cameras, of every target sent; prints what happens."""
    station, rows, due = station_for(scene), [], None
    stream = messages(scene, end_s)
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


def yaw_aligned(live: np.ndarray, truth: np.ndarray) -> tuple[float, float, float]:
    """RMSE m, clock s and yaw deg of positions (N, 4: s, ENU) against truth (M, 4), time, yaw and shift found."""
    best = (np.inf, 0.0, 0.0)
    for span, step in ((None, 1.0), (1.0, 0.1), (0.1, 0.01)):
        centre = best[1]
        low = truth[0, 0] - live[-1, 0] if span is None else centre - span
        high = truth[-1, 0] - live[0, 0] if span is None else centre + span
        for shift in np.arange(low, high + step / 2, step):
            best = min(best, (*_aligned(live, truth, shift),))
    return best


def _aligned(live: np.ndarray, truth: np.ndarray, shift: float) -> tuple[float, float, float]:
    t = live[:, 0] + shift
    inside = (t >= truth[0, 0]) & (t <= truth[-1, 0])
    if np.count_nonzero(inside) < 0.7 * len(t):
        return np.inf, shift, 0.0
    a = live[inside, 1:4]
    b = np.column_stack([np.interp(t[inside], truth[:, 0], truth[:, k]) for k in (1, 2, 3)])
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    turn = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, :2] * b[:, :2]))
    c, s = np.cos(turn), np.sin(turn)
    turned = a @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return float(np.sqrt(np.mean(np.sum((turned - b) ** 2, axis=1)))), shift, float(np.degrees(turn))


def main() -> None:
    """Play and score."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--to", type=float, default=1e9, help="seconds of the recording")
    parser.add_argument(
        "--solve-s", type=float, help="seconds of the recording that a solve takes; default: as it took"
    )
    options = parser.parse_args()
    scene = play_back(options.folder).scene
    live = play(scene, options.to, options.solve_s)
    if not len(live):
        print("nothing was sent")
        return
    sigma_m = np.median(live[:, 4])
    print(f"first position {live[0, 0]:.1f} s after the first row; {len(live)} sent; median sigma {sigma_m:.2f} m")
    truth_file = options.folder / "truth.csv"
    if truth_file.exists():
        with truth_file.open() as stream:
            rows = [row for row in csv.reader(stream) if row and row[0][:1].lstrip("-").isdigit()]
        truth = np.array([[float(cell) for cell in row[:4]] for row in rows])
        for name, sent in (("all", live), ("seen by 2 or more", live[live[:, 5] >= 2])):
            rmse, shift, turn = yaw_aligned(sent[:: max(1, len(sent) // 4000)], truth)
            print(f"{name}: yaw-aligned RMSE {rmse:.3f} m (clock {shift:.2f} s, yaw {turn:.2f} deg)")


if __name__ == "__main__":
    main()
