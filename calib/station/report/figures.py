"""The report's figures. Each takes the solution and gives an SVG; what they show is explained where they stand."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from calib.network import Camera
from calib.solving.solution import Solution, Trajectory
from calib.station.report.drawing import FAINT, INK, colour, draw
from calib.station.report.summary import evidence_of, predict_around
from edge.common.arrays import Array
from edge.lens import pixel_to_ray

DRAWN_ROWS: Final = 1500  # of a flight: as many as a screen has columns
GAP_ROWS: Final = 3  # rows missing, beyond which a line is broken
ELLIPSE_S: Final = 15.0  # between ellipses on the map
SHADED: Final = 0.18


def _thinned(flown: Trajectory, track: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Rows of a track to draw, and after which of them the line is to be broken."""
    rows = np.flatnonzero(flown.track == track)
    step = int(np.median(np.diff(flown.t_unix_ns[rows]))) if len(rows) > 1 else 1
    ends = np.flatnonzero(np.diff(flown.t_unix_ns[rows]) > GAP_ROWS * step)
    every = max(1, len(flown.t_unix_ns) // DRAWN_ROWS)
    kept = np.zeros(len(rows), bool)
    kept[::every] = True
    kept[np.concatenate([ends, ends + 1, [len(rows) - 1]]).astype(int)] = True
    broken = np.zeros(len(rows), bool)
    broken[ends] = True
    return rows[kept], broken[kept]


def _broken(values: NDArray[np.floating[Any]], breaks: NDArray[np.bool_]) -> Array:
    """Values (N,) or (N, d) with a NaN after each break, so that no line is drawn where nobody saw anything."""
    result: Array = np.insert(values, np.flatnonzero(breaks) + 1, np.nan, axis=0)
    return result


def flight_map(solution: Solution) -> str:
    """Seen from above: the flight, its error ellipses, the cameras and what they see."""

    def paint(figure: Any) -> None:
        axes = figure.add_subplot()
        for index, camera in enumerate(solution.network.cameras):
            _camera_from_above(axes, camera, colour(index), _reach_m(solution))
        for track in np.unique(solution.trajectory.track):
            rows, breaks = _thinned(solution.trajectory, int(track))
            path = _broken(solution.trajectory.points_enu[rows, :2], breaks)
            axes.plot(path[:, 0], path[:, 1], color=INK, linewidth=0.9)
        axes.set_aspect("equal", "datalim")
        axes.set_xlabel("east, m")
        axes.set_ylabel("north, m")
        axes.set_title("From above")

    return draw(5.6, 5.2, paint)


def _reach_m(solution: Solution) -> float:
    return 0.35 * float(np.ptp(solution.trajectory.points_enu[:, :2], axis=0).max())


def _camera_from_above(axes: Any, camera: Camera, tint: str, reach_m: float) -> None:
    width, height = camera.lens.size_px
    sides = pixel_to_ray(camera.lens, np.array([[0.0, height / 2], [width - 1.0, height / 2]]))
    east, north = camera.centre_enu[:2]
    if np.all(np.isfinite(sides)):
        ends = np.column_stack([sides, np.ones(2)]) @ camera.R_cam_enu
        flat = ends[:, :2] / np.linalg.norm(ends[:, :2], axis=1, keepdims=True) * reach_m + (east, north)
        axes.fill([east, *flat[:, 0]], [north, *flat[:, 1]], color=tint, alpha=SHADED / 2, linewidth=0)
    axes.plot(east, north, marker="o", color=tint, markersize=7, markeredgecolor="white")
    axes.annotate(camera.id, (east, north), (6, 5), textcoords="offset points", color=tint, fontweight="bold")


def flight_3d(solution: Solution) -> str:
    """The same in three dimensions, with the cameras' optical axes."""

    def paint(figure: Any) -> None:
        axes = figure.add_subplot(projection="3d", computed_zorder=False)
        for track in np.unique(solution.trajectory.track):
            rows, breaks = _thinned(solution.trajectory, int(track))
            path = _broken(solution.trajectory.points_enu[rows], breaks)
            axes.plot(path[:, 0], path[:, 1], path[:, 2], color=INK, linewidth=0.8)
        for index, camera in enumerate(solution.network.cameras):
            end = camera.centre_enu + 0.4 * _reach_m(solution) * camera.R_cam_enu[2]
            line = np.vstack([camera.centre_enu, end])
            axes.plot(line[:, 0], line[:, 1], line[:, 2], color=colour(index))
            axes.plot(*camera.centre_enu[:, None], marker="o", color=colour(index))
        axes.set_xlabel("east, m")
        axes.set_ylabel("north, m")
        axes.set_zlabel("up, m")
        axes.set_box_aspect(None, zoom=0.9)
        axes.set_title("In three dimensions")

    return draw(5.6, 5.2, paint)


def axes_over_time(solution: Solution) -> str:
    """East, north and up with one-sigma bands, the sigmas themselves, and how many cameras saw it."""
    flown = solution.trajectory

    def paint(figure: Any) -> None:
        panels = figure.subplots(5, 1, sharex=True, height_ratios=(3, 3, 3, 2.2, 1.2))
        start_ns = int(flown.t_unix_ns.min())
        for track in np.unique(flown.track):
            rows, breaks = _thinned(flown, int(track))
            seconds = _broken((flown.t_unix_ns[rows] - start_ns) * 1e-9, breaks)
            points = _broken(flown.points_enu[rows], breaks)
            sigma = _broken(np.sqrt(np.diagonal(flown.covariance_enu[rows], axis1=1, axis2=2)), breaks)
            seeing = _broken(flown.cameras[rows].astype(float), breaks)
            for axis in range(3):
                low, high = points[:, axis] - sigma[:, axis], points[:, axis] + sigma[:, axis]
                panels[axis].fill_between(seconds, low, high, color=colour(axis), alpha=0.35, linewidth=0)
                panels[axis].plot(seconds, points[:, axis], color=colour(axis), linewidth=0.8)
                panels[3].plot(seconds, sigma[:, axis], color=colour(axis), linewidth=0.9)
            panels[4].plot(seconds, seeing, color=INK, linewidth=0.9, drawstyle="steps-post")
        for panel, label in zip(panels, ("east, m", "north, m", "up, m", "one sigma, m", "cameras"), strict=True):
            panel.set_ylabel(label)
        panels[3].set_ylim(0, 1.3 * float(np.percentile(np.sqrt(flown.covariance_enu[:, 2, 2]), 98)))
        panels[4].set_ylim(0, len(solution.network.cameras) + 0.5)
        panels[4].set_xlabel("seconds from the first position")

    return draw(11.0, 7.2, paint)


def residuals_on_image(solution: Solution) -> str:
    """For each camera the mean residual by place in its image, as arrows, and how often the object was there."""
    places, names = evidence_of(solution).by_place, [camera.id for camera in solution.report.cameras]
    columns = min(3, len(names))
    lines = -(-len(names) // columns)

    def paint(figure: Any) -> None:
        panels = figure.subplots(lines, columns, squeeze=False).ravel()
        for panel in panels[len(names) :]:
            panel.set_visible(False)
        for index, (panel, place, name) in enumerate(zip(panels, places, names, strict=False)):
            (width, height), cells = place.size_px, place.rows.shape
            v, u = np.meshgrid(
                (np.arange(cells[0]) + 0.5) * height / cells[0],
                (np.arange(cells[1]) + 0.5) * width / cells[1],
                indexing="ij",
            )
            shade = np.log1p(place.rows)
            panel.imshow(shade, extent=(0, width, height, 0), cmap="Greys", alpha=0.35, vmin=0, vmax=12)
            seen = place.weight > 0
            longest = max(solution.report.cameras[index].sigma_px, 1e-9)
            mean = place.mean_px[seen] / longest * width / cells[1] / 2
            panel.quiver(
                u[seen], v[seen], mean[:, 0], mean[:, 1], color=colour(index), angles="xy", scale_units="xy", scale=1
            )
            panel.set_xlim(0, width)
            panel.set_ylim(height, 0)
            panel.grid(visible=False)
            panel.set_xticks([0, width])
            panel.set_yticks([0, height])
            panel.set_title(f"{name}: half a cell is {longest:.2f} px")

    return draw(11.0, 2.6 * lines, paint)


def clocks(solution: Solution) -> str:
    """Each camera's clock offset with one sigma, in milliseconds."""
    cameras = solution.report.cameras

    def paint(figure: Any) -> None:
        axes = figure.add_subplot()
        for index, camera in enumerate(cameras):
            at, sigma = camera.clock_offset_s * 1e3, camera.sigma_offset_s * 1e3
            axes.errorbar(at, -index, xerr=sigma, marker="o", color=colour(index), capsize=4)
        axes.axvline(0, color=FAINT, zorder=0)
        axes.set_yticks([-i for i in range(len(cameras))], [camera.id for camera in cameras])
        axes.set_ylim(-len(cameras) + 0.5, 0.5)
        axes.set_xlabel("clock offset, ms: added to the camera's stamps")

    return draw(5.6, 0.9 + 0.32 * len(cameras), paint)


def shared_graph(solution: Solution) -> str:
    """The cameras where they stand, joined by lines as thick as they have rows of the same object."""
    shared = evidence_of(solution).shared_rows
    cameras = solution.network.cameras
    most = max(1, int((shared - np.diag(np.diag(shared))).max()))

    def paint(figure: Any) -> None:
        axes = figure.add_subplot()
        for i, one in enumerate(cameras):
            for j in range(i + 1, len(cameras)):
                ends = np.vstack([one.centre_enu, cameras[j].centre_enu])
                rows = int(min(shared[i, j], shared[j, i]))
                style = ":" if rows == 0 else "-"
                width = 0.8 if rows == 0 else 0.8 + 6 * rows / most
                axes.plot(ends[:, 0], ends[:, 1], style, color="#d1242f" if rows == 0 else FAINT, linewidth=width)
                spot = 0.6 * ends[0] + 0.4 * ends[1]  # not the middle, where lines of a ring cross
                axes.annotate(f"{rows}", spot[:2], fontsize=7.5, ha="center", va="center", color=INK)
        for index, camera in enumerate(cameras):
            axes.plot(*camera.centre_enu[:2], marker="o", color=colour(index), markersize=9, markeredgecolor="white")
            axes.annotate(
                camera.id,
                camera.centre_enu[:2],
                (7, 6),
                textcoords="offset points",
                color=colour(index),
                fontweight="bold",
            )
        axes.set_aspect("equal", "datalim")
        axes.margins(0.12)
        axes.set_xlabel("east, m")
        axes.set_ylabel("north, m")

    return draw(5.6, 4.6, paint)


def sky(solution: Solution, distance_m: float) -> str:
    """Predicted sigma around the middle of the cameras; the zenith is in the middle, the rim is the lowest."""
    directions, prediction = predict_around(solution, distance_m)

    def paint(figure: Any) -> None:
        from matplotlib.colors import LogNorm  # noqa: PLC0415 -- see drawing.py

        axes = figure.add_subplot(projection="polar")
        axes.set_theta_zero_location("N")
        axes.set_theta_direction(-1)
        angle = np.arctan2(directions[:, 0], directions[:, 1])
        zenith = 90 - np.degrees(np.arcsin(directions[:, 2]))
        known = prediction.cameras >= 2
        axes.scatter(angle[~known], zenith[~known], s=5, color=FAINT)
        if known.any():
            sigma = prediction.sigma_m[known]
            low, high = np.percentile(sigma, (2, 95))
            dots = axes.scatter(
                angle[known],
                zenith[known],
                c=sigma,
                s=22,
                cmap="viridis_r",
                norm=LogNorm(low, max(float(high), 1.5 * float(low))),
            )
            bar = figure.colorbar(dots, ax=axes, shrink=0.75, label="one sigma, m")
            bar.ax.yaxis.set_major_formatter("{x:.2g}")
            bar.ax.yaxis.set_minor_formatter("{x:.2g}")
        axes.set_rlim(0, max(90.0, float(zenith.max())))
        axes.set_rticks([30, 60, 90], ["60°", "30°", "0°"])
        axes.set_xticks(np.radians([0, 90, 180, 270]), ["N", "E", "S", "W"])

    return draw(5.6, 4.6, paint)


def direction_words(solution: Solution) -> str:
    """The weakest direction in words, such as `along north-south`."""
    east, north, up = np.abs(solution.report.weakest_direction_enu).tolist()
    if up > max(east, north):
        return "in height"
    if max(east, north) > 2.4 * min(east, north):  # within 22.5 degrees of an axis
        return "along east-west" if east > north else "along north-south"
    same = solution.report.weakest_direction_enu[0] * solution.report.weakest_direction_enu[1] > 0
    return "along southwest-northeast" if same else "along northwest-southeast"
