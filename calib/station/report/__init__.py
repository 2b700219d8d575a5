"""The report on a calibration: report.html for people, report.json for programs, from one struct.

Written by `base-station solve`, and by the live station at each accepted calibration. Same input, same bytes.
"""

from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from calib.solving.solution import Solution
from calib.station.report import figures, grade, html
from calib.station.report.summary import (
    DISTANCES_M,
    MIDDLE_DISTANCE_M,
    REPORT_FORMAT,
    Summary,
    camera_summaries,
    claims_summary,
    flight_summary,
    pair_summaries,
    predicted,
    survey_summary,
)
from edge.common.atomic import write_atomically

__all__ = ["HTML", "JSON", "Summary", "summarise", "to_html", "to_json", "write_report"]

HTML: Final = "report.html"
JSON: Final = "report.json"


def summarise(solution: Solution) -> Summary:
    """Everything the report says, judged."""
    report = solution.report
    cameras, pairs, flight = camera_summaries(solution), pair_summaries(solution), flight_summary(solution)
    survey = survey_summary(solution)
    left_out = dict(report.left_out)
    claims = grade.claims(report.strain, report.findings)
    weakest = grade.weakest(report.weakest_camera, report.weakest_sigma_m, figures.direction_words(solution))
    marks = grade.marks(cameras, left_out, pairs, flight, survey=survey, claims=claims, weakest=weakest)
    distances = [predicted(solution, distance_m) for distance_m in DISTANCES_M]
    return Summary(
        format=REPORT_FORMAT,
        site=solution.network.site,
        origin=solution.network.origin,
        network=solution.network.fingerprint,
        grade=grade.worst(marks).grade,
        verdict=grade.verdict(marks),
        improvement=grade.improvement(marks, distances[DISTANCES_M.index(MIDDLE_DISTANCE_M)]),
        marks=marks,
        findings=list(map(str, report.findings)),
        left_out=left_out,
        rms_px=report.rms_px,
        survey_rms_m=report.survey_rms_m,
        survey=survey,
        claims=claims_summary(report.strain),
        flight=flight,
        weakest_camera=report.weakest_camera,
        weakest_sigma_m=report.weakest_sigma_m,
        weakest_direction_enu=report.weakest_direction_enu,
        predicted=distances,
        cameras=cameras,
        pairs=pairs,
    )


def to_json(summary: Summary) -> bytes:
    """report.json; NaN and infinity, which JSON has not, come out as null."""
    return msgspec.json.format(msgspec.json.encode(summary, enc_hook=_plain), indent=2) + b"\n"


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value)} in a report")


def to_html(solution: Solution, summary: Summary) -> str:
    """report.html."""
    drawn = {
        "map": figures.flight_map(solution),
        "3d": figures.flight_3d(solution),
        "axes": figures.axes_over_time(solution),
        "residuals": figures.residuals_on_image(solution),
        "clocks": figures.clocks(solution),
        "graph": figures.shared_graph(solution),
        "sky": figures.sky(solution, MIDDLE_DISTANCE_M),
    }
    return html.page(summary, drawn)


def write_report(solution: Solution, folder: Path) -> Summary:
    """Write report.html and report.json into a folder that exists. Raises OSError."""
    summary = summarise(solution)
    write_atomically(folder / HTML, to_html(solution, summary).encode())
    write_atomically(folder / JSON, to_json(summary))
    return summary
