"""A simulated scene as a track folder (deploy/CONTRACTS.md), with the truth beside it.

`site.toml` and `tracks/` hold what a real site would; `truth.csv` (the first object), `truth/<object>.csv` (each of
them) and `truth.toml` (the true network) are what only a simulation can know. The truth is in the site's frame and on
its clock, in seconds since 1970: nothing needs to be aligned.
"""

from pathlib import Path

import numpy as np
import tomli_w

from calib.geodesy import enu_to_geodetic
from calib.network import to_toml
from calib.observations import Scene, SiteCamera
from calib.simulation.simulation import Rows, Simulated
from edge.common.arrays import Array

TRACKS_HEADER = "t_unix_ns,u_px,v_px,track,width_px,height_px,score,status"


def write_folder(simulated: Simulated, folder: Path, truth_rate_hz: float = 20.0) -> None:
    """Write everything below `folder`, which is made if need be. The same scene writes the same bytes."""
    for part in (folder / "tracks", folder / "truth"):
        part.mkdir(parents=True, exist_ok=True)
    (folder / "site.toml").write_text(site_toml(simulated.scene), encoding="utf-8")
    (folder / "truth.toml").write_text(to_toml(simulated.network), encoding="utf-8")
    for camera, rows in simulated.rows.items():
        (folder / "tracks" / f"{camera}.csv").write_text(_track_csv(rows), encoding="utf-8")
    for number, path in enumerate(simulated.flights, start=1):
        text = _truth_csv(simulated, number, truth_rate_hz)
        (folder / "truth" / f"{path.object.name}.csv").write_text(text, encoding="utf-8")
        if number == 1:
            (folder / "truth.csv").write_text(text, encoding="utf-8")


def site_toml(scene: Scene) -> str:
    """The site file of a scene: what is believed of its cameras."""
    site = {"name": scene.site, "origin": list(scene.origin)}
    return tomli_w.dumps({"site": site, "camera": [_site_camera(camera, scene) for camera in scene.cameras]})


def _site_camera(camera: SiteCamera, scene: Scene) -> dict[str, object]:
    entry: dict[str, object] = {
        "id": camera.id,
        "size_px": list(camera.lens.size_px),
        "lens": camera.lens.model,
        "intrinsics": list(camera.lens.intrinsics),
        "distortion": list(camera.lens.distortion),
    }
    if camera.position_enu is not None and camera.position_covariance is not None:
        lat, lon, height = enu_to_geodetic(camera.position_enu, scene.origin)[0].tolist()
        entry["position"] = [lat, lon, height]
        entry["position_sigma"] = np.sqrt(np.diag(camera.position_covariance)).tolist()
    if camera.clock_bound_s is not None:
        entry["clock_bound_s"] = camera.clock_bound_s
    if camera.readout_s is not None:
        entry["readout_s"] = camera.readout_s
    if camera.up_cam is not None and camera.up_sigma_deg is not None:
        entry["up_cam"] = camera.up_cam.tolist()
        entry["up_sigma_deg"] = camera.up_sigma_deg
    return entry


def _track_csv(rows: Rows) -> str:
    score = np.where(rows.source > 0, 0.9, 0.5)
    lines = [TRACKS_HEADER]
    for t, (u, v), track, (width, height), s in zip(
        rows.t_unix_ns.tolist(), rows.pixels.tolist(), rows.track.tolist(), rows.size_px.tolist(), score, strict=True
    ):
        lines.append(f"{t},{u:.9f},{v:.9f},{track},{width:.2f},{height:.2f},{s:.2f},confirmed")
    return "\n".join(lines) + "\n"


def _truth_csv(simulated: Simulated, number: int, rate_hz: float) -> str:
    step_ns = round(1e9 / rate_hz)
    count = int(simulated.duration_s * 1e9) // step_ns + 1
    t_unix_ns = simulated.start_unix_ns + np.arange(count, dtype=np.int64) * step_ns
    positions = simulated.truth_enu(t_unix_ns, number)
    flying = np.isfinite(positions[:, 0])
    lines = ["t_s,east_m,north_m,up_m"]
    lines += [_truth_row(t, at) for t, at in zip(t_unix_ns[flying].tolist(), positions[flying], strict=True)]
    return "\n".join(lines) + "\n"


def _truth_row(t_unix_ns: int, position: Array) -> str:
    # Written from the integer: a double of seconds since 1970 is good to 0.2 us only.
    seconds, rest = divmod(t_unix_ns, 10**9)
    return f"{seconds}.{rest:09d}," + ",".join(f"{value:.9f}" for value in position.tolist())
