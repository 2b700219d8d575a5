"""report.html: one file that opens anywhere, with scripts disabled and no network, and prints.

Nothing is judged or counted here; it is all in the Summary. Every word that came from outside is escaped: a camera's
name is the user's, and a report is opened by others.
"""

from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

from calib.station.report.summary import CameraSummary, Summary

STYLE: Final = """
:root { color-scheme: light; --ink: #1d2733; --soft: #57636f; --line: #dde3e8; --paper: #ffffff; --back: #f4f6f8 }
* { box-sizing: border-box }
body { margin: 0; background: var(--back); color: var(--ink); font: 15px/1.5 system-ui, sans-serif }
main { max-width: 1120px; margin: 0 auto; padding: 24px 16px 64px }
section, header { background: var(--paper); border: 1px solid var(--line); border-radius: 10px; padding: 18px 22px;
  margin-bottom: 16px }
h1 { font-size: 26px; margin: 0 } h2 { font-size: 18px; margin: 0 0 8px } p { margin: 6px 0; max-width: 95ch }
.soft { color: var(--soft) }
.head { display: flex; gap: 22px; align-items: center; flex-wrap: wrap }
.grade { font-size: 54px; font-weight: 700; line-height: 1; width: 92px; height: 92px; border-radius: 16px;
  display: grid; place-items: center; color: #fff; flex: none }
.A { background: #1a7f37 } .B { background: #4d8a1c } .C { background: #9a6700 } .D { background: #bc4c00 }
.E { background: #cf222e }
.chip { display: inline-block; min-width: 26px; text-align: center; border-radius: 6px; color: #fff;
  font-weight: 700; padding: 1px 7px }
.advice { border-left: 5px solid #0969da; padding: 4px 0 4px 14px; margin-top: 14px }
dl { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px; margin: 16px 0 0 }
dt { color: var(--soft); font-size: 13px } dd { margin: 0; font-size: 20px; font-weight: 600 }
.scroll { overflow-x: auto }
table { border-collapse: collapse; width: 100%; font-size: 14px; font-variant-numeric: tabular-nums }
th, td { text-align: right; padding: 4px 7px; border-bottom: 1px solid var(--line); white-space: nowrap }
th { color: var(--soft); font-weight: 600; font-size: 13px; vertical-align: bottom }
th:first-child, td:first-child, .words { text-align: left } td.words { white-space: normal; min-width: 220px }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 430px), 1fr)); gap: 12px }
figure { margin: 8px 0 0; overflow-x: auto } figcaption { color: var(--soft); font-size: 13px }
svg { width: 100%; height: auto; display: block }
@media print { body { background: #fff } section, header { break-inside: avoid; border: 0; padding: 8px 0 } }
"""


def page(summary: Summary, figures: dict[str, str]) -> str:
    """The whole document. figures: SVG elements by name, as `report.figures` makes them."""
    parts = [
        _header(summary),
        _marks(summary),
        _flight(summary, figures),
        _cameras(summary, figures),
        _survey(summary),
        _clocks(summary, figures),
        _lenses(summary),
        _pairs(summary, figures),
        _predicted(summary, figures),
    ]
    title = f"Calibration of {escape(summary.site)}"
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f"<title>{title}</title><style>{STYLE}</style></head><body><main>\n"
        + "\n".join(parts)
        + "\n</main></body></html>\n"
    )


def _header(summary: Summary) -> str:
    survey = "none" if summary.survey_rms_m is None else f"{summary.survey_rms_m:.3f} m"
    facts = {
        "cameras": f"{len(summary.cameras)} of {len(summary.cameras) + len(summary.left_out)}",
        "flight": f"{summary.flight.seconds:.0f} s",
        "residual, rms": f"{summary.rms_px:.2f} px",
        "survey misfit, rms": survey,
        "flight known to": f"{summary.flight.sigma_m:.2f} m",
        **{f"predicted at {p.distance_m:.0f} m": _metres(p.sigma_m) for p in summary.predicted},
    }
    found = "".join(f"<p><strong>Found:</strong> {escape(finding)}</p>" for finding in summary.findings)
    return (
        f'<header><div class="head"><div class="grade {summary.grade}" role="img" aria-label="grade {summary.grade}">'
        f"{summary.grade}</div><div><h1>Calibration of {escape(summary.site)}</h1>"
        f"<p>{escape(_sentence(summary.verdict))}</p>"
        f'<p class="soft">network {summary.network}, origin {summary.origin[0]:.7f}°, {summary.origin[1]:.7f}°, '
        f"{summary.origin[2]:.2f} m above the ellipsoid</p></div></div>{found}"
        '<div class="advice"><strong>What would improve it most:</strong> '
        f"{escape(_sentence(summary.improvement))}</div>"
        f"<dl>{''.join(f'<div><dt>{k}</dt><dd>{v}</dd></div>' for k, v in facts.items())}</dl></header>"
    )


def _marks(summary: Summary) -> str:
    rows = [
        [f'<span class="chip {m.grade}">{m.grade}</span> {escape(m.name)}', escape(m.reason), escape(m.action)]
        for m in summary.marks
    ]
    left = "".join(f"<li><strong>{escape(n)}</strong>: {escape(w)}</li>" for n, w in summary.left_out.items())
    left = f"<h2>Left out</h2><ul>{left}</ul>" if left else ""
    return _section(
        "What was judged",
        "The grade is the worst of these. The live station has limits of its own and refuses what is worse.",
        _table(["mark", "why", "what would raise it"], rows, words=(1, 2)) + left,
    )


def _flight(summary: Summary, figures: dict[str, str]) -> str:
    flown = summary.flight
    text = (
        f"{flown.rows} positions of {flown.tracks} track(s), {flown.span_m[0]:.0f} m east-west, "
        f"{flown.span_m[1]:.0f} m north-south, {flown.span_m[2]:.0f} m high, at {flown.speed_m_s:.1f} m/s. "
        f"One sigma in 3D is {flown.sigma_m:.2f} m for half of them, {flown.often_m:.2f} m for nine of ten."
    )
    pair = _figure(figures["map"], "Cameras with what they see left to right; the flight in black.") + _figure(
        figures["3d"], "Lines from the cameras are their optical axes."
    )
    bands = _figure(
        figures["axes"],
        "Bands are one sigma, thinner than the line where it is small: see the fourth panel (blue east, orange north, "
        "green up). Lines are broken where fewer than two cameras saw it.",
    )
    return _section("The flight", text, f'<div class="pair">{pair}</div>{bands}')


def _cameras(summary: Summary, figures: dict[str, str]) -> str:
    head = [
        "camera",
        "rows",
        "within the noise",
        "sigma, px",
        "sigma, mrad",
        "held out, px",
        "expected, px",
        "fitted, px",
    ]
    head += ["by place, px", "image crossed", "lives for, s"]
    rows = [
        [
            escape(c.id),
            f"{c.rows}",
            f"{c.inlier_share:.0%}",
            f"{c.sigma_px:.2f}",
            f"{c.sigma_mrad:.2f}",
            "–" if c.held_out_px is None else f"{c.held_out_px:.2f}",
            "–" if c.expected_px is None else f"{c.expected_px:.2f}",
            "–" if c.fitted_px is None else f"{c.fitted_px:.2f}",
            f"{c.pattern_px:.2f}",
            f"{c.coverage:.0%}",
            f"{c.correlated_s:.2f}",
        ]
        for c in summary.cameras
    ]
    text = (
        "Held out: stretches of three seconds were taken from one camera at a time, the rest adjusted again, and what "
        "was taken was predicted, to be compared with what was expected; fitted: the same rows when they took part. "
        "Lives for: how long an error of the detector lasts; within it, many rows say as much as one."
    )
    arrows = _figure(
        figures["residuals"],
        "Mean residual, predicted minus seen, by place in the image. Arrows that point all one way within a region are "
        "the lens; darker is where the object was more often.",
    )
    return _section("Residuals", text, _table(head, rows) + arrows)


def _survey(summary: Summary) -> str:
    head = ["camera", "east, m", "north, m", "up, m", "sigma east", "sigma north", "sigma up", "roll, pitch, yaw, mrad"]
    rows = [
        [
            escape(c.id),
            *(["–"] * 3 if c.survey_misfit_m is None else [f"{v:+.3f}" for v in c.survey_misfit_m]),
            *(f"{v:.3f}" for v in c.sigma_centre_m),
            " ".join(f"{1e3 * v:.2f}" for v in c.sigma_attitude_rad),
        ]
        for c in summary.cameras
    ]
    test = "" if summary.survey is None else _sentence(summary.survey.words)
    text = f"Estimated minus surveyed position, and how certain the estimate is (one sigma). {test}"
    east, north, up = summary.weakest_direction_enu
    weak = (
        f"<p>Weakest: {escape(summary.weakest_camera)}, {summary.weakest_sigma_m:.3f} m along "
        f"({east:+.2f} east, {north:+.2f} north, {up:+.2f} up).</p>"
    )
    return _section("Survey and poses", text, _table(head, rows) + weak)


def _clocks(summary: Summary, figures: dict[str, str]) -> str:
    head = ["camera", "offset, ms", "± ms", "rate, ppm", "± ppm", "readout, ms", "± ms"]
    rows = [
        [
            escape(c.id),
            f"{1e3 * c.clock_offset_s:+.2f}",
            f"{1e3 * c.sigma_offset_s:.2f}",
            f"{1e6 * c.clock_rate:+.1f}",
            f"{1e6 * c.sigma_rate:.1f}",
            f"{1e3 * c.readout_s:.1f}",
            f"{1e3 * c.sigma_readout_s:.1f}",
        ]
        for c in summary.cameras
    ]
    text = "The camera with offset 0 ± 0 is the site's time. Readout is the rolling shutter's, first row to last."
    return _section("Clocks", text, f'<div class="pair">{_table(head, rows)}{_figure(figures["clocks"], "")}</div>')


def _lenses(summary: Summary) -> str:
    head = ["camera", "fx", "fy", "cx", "cy", "k1"]
    rows = [row for camera in summary.cameras for row in _lens_rows(camera)]
    return _section("Lenses before and after", "In pixels.", _table(head, rows))


def _lens_rows(c: CameraSummary) -> list[list[str]]:
    before = [f"{v:.1f}" for v in c.intrinsics_before] + [f"{c.k1_before:+.4f}"]
    after = [f"{v:.1f}" for v in c.intrinsics_after] + [f"{c.k1_after:+.4f}"]
    sigma = [f"± {v:.1f}" for v in c.sigma_lens[:4]] + [f"± {c.sigma_lens[4]:.4f}"]
    return [
        [f"<strong>{escape(c.id)}</strong>, {c.lens_model}: file", *before],
        ["estimate", *after],
        ["one sigma", *sigma],
    ]


def _pairs(summary: Summary, figures: dict[str, str]) -> str:
    names = [c.id for c in summary.cameras]
    count = {frozenset((p.one, p.other)): p.shared_rows for p in summary.pairs}
    rows = [
        [
            f"<strong>{escape(one)}</strong>",
            *("·" if one == other else f"{count[frozenset((one, other))]}" for other in names),
        ]
        for one in names
    ]
    table = _table(["rows both have", *map(escape, names)], rows)
    graph = _figure(figures["graph"], "Thicker is more; a dotted red line is a pair that never saw the same object.")
    return _section(
        "Shared observations",
        "Only what two cameras see at once ties them together.",
        f'<div class="pair">{table}{graph}</div>',
    )


def _predicted(summary: Summary, figures: dict[str, str]) -> str:
    head = [
        "distance",
        "median",
        "nine of ten",
        "horizontal",
        "vertical",
        "seen by two",
        "of it pixels",
        "most from",
    ]
    rows = [
        [
            f"{p.distance_m:.0f} m",
            _metres(p.sigma_m),
            _metres(p.often_m),
            _metres(p.horizontal_m),
            _metres(p.vertical_m),
            f"{p.seen_share:.0%}",
            "–" if p.pixel_share is None else f"{p.pixel_share:.0%}",
            escape(p.worst_camera or "–"),
        ]
        for p in summary.predicted
    ]
    text = (
        "One sigma in 3D of a single instant, without smoothing, from this network's own noise, poses and lenses, at "
        "that distance from the middle of the cameras, over all directions that two of them see. A filter does better."
    )
    figure = _figure(
        figures["sky"], "Looking up at 300 m: north is up, the zenith in the middle; grey: fewer than two cameras."
    )
    return _section("Predicted uncertainty", text, f'<div class="pair">{_table(head, rows)}{figure}</div>')


def _section(title: str, text: str, body: str) -> str:
    return f"<section><h2>{title}</h2><p>{escape(text)}</p>{body}</section>"


def _figure(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], words: tuple[int, ...] = ()) -> str:
    """Cells are HTML already. words: columns of prose."""

    def prose(column: int) -> str:
        return ' class="words"' if column in words else ""

    cells = ("".join(f"<td{prose(i)}>{cell}</td>" for i, cell in enumerate(row)) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    top = "".join(f"<th{prose(i)}>{name}</th>" for i, name in enumerate(head))
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _metres(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f} m"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")
