"""Status as HTML, for a person. Pure: a struct in, text out, every foreign word escaped.

A colour is never alone: each cell and light has a word with it, for the colour-blind and the screen reader.
"""

from collections.abc import Iterable
from html import escape
from typing import Final
from urllib.parse import quote

from calib.station.page.steps import ChecklistStep, next_step, steps
from calib.station.status.status import CameraStatus, PairStatus, StationStatus
from edge.messages import Health

WORDS: Final = {"ok": "good", "warn": "look", "fail": "wrong"}
CHECKS: Final = {"ok": "PASS", "warn": "WARN", "fail": "FAIL"}
PAIR_MRAD: Final = (2.0, 5.0)  # between two rays; a pixel is about 1 mrad, and beyond 5 one of the two is wrong
NEXT_TO_NOTHING: Final = 0.2  # of the seconds that a pair must share before it is solved from


def light(level: str, words: dict[str, str] = WORDS) -> str:
    """A coloured word."""
    return f'<span class="light {level}">{words[level]}</span>'


def banner(status: StationStatus) -> str:
    """Phase, reason and next action, on top of every page."""
    level = {"calibrated": "ok", "blind": "fail"}.get(status.phase, "warn")
    action = f' <span class="do">{escape(status.action)}</span>' if status.action else ""
    return f'<span class="light {level}">{escape(status.phase)}</span> <span>{escape(status.reason)}</span>{action}'


def step_list(status: StationStatus) -> str:
    """The five steps, the first that is not green marked as the next."""
    found = steps(status)
    ahead = next_step(found)
    items = "".join(_step(index, step, step is ahead) for index, step in enumerate(found, 1))
    return f'<ol class="steps">{items}</ol>'


def _step(number: int, step: ChecklistStep, is_next: bool) -> str:
    action = f'<p class="do">{escape(step.action)}</p>' if step.action and step.level != "ok" else ""
    current = ' aria-current="step"' if is_next else ""
    return (
        f'<li class="step {step.level}" data-step="{step.name}" data-level="{step.level}"{current}>'
        f"<h3>{number}. {step.name} {light(step.level)}</h3><p>{escape(step.reason)}</p>{action}</li>"
    )


def pair_matrix(status: StationStatus, focal_px: dict[str, float]) -> str:
    """Each pair's shared seconds and residual, mrad and px; on the diagonal the camera's clock offset."""
    names = [camera.id for camera in status.cameras]
    pairs = {frozenset((pair.one, pair.other)): pair for pair in status.pairs}
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in names)
    rows = []
    for camera in status.cameras:
        cells = [
            _clock(camera)
            if other == camera.id
            else _pair(pairs.get(frozenset((camera.id, other))), focal_px, status.first_solve_s)
            for other in names
        ]
        rows.append(f'<tr><th scope="row">{escape(camera.id)}</th>{"".join(cells)}</tr>')
    return (
        '<div class="scroll"><table class="matrix">'
        "<caption>One red cell is an outlier, a red row is that camera.</caption>"
        f"<thead><tr><td></td>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def pair_level(pair: PairStatus, first_solve_s: float) -> str:
    """How a pair is doing. first_solve_s: what it must share before the first attempt (StationStatus)."""
    if pair.residual_mrad is not None:  # both are calibrated: now it counts how well they agree
        return "ok" if pair.residual_mrad <= PAIR_MRAD[0] else "warn" if pair.residual_mrad <= PAIR_MRAD[1] else "fail"
    shared = pair.shared_s / first_solve_s
    return "ok" if shared >= 1.0 else "warn" if shared >= NEXT_TO_NOTHING else "fail"


def _pair(pair: PairStatus | None, focal_px: dict[str, float], first_solve_s: float) -> str:
    if pair is None:
        return "<td>–</td>"
    level = pair_level(pair, first_solve_s)
    miss = "–"
    if pair.residual_mrad is not None:
        focal = [focal_px[name] for name in (pair.one, pair.other) if name in focal_px]
        pixels = f", {pair.residual_mrad * 1e-3 * sum(focal) / len(focal):.1f} px" if focal else ""
        miss = f"{pair.residual_mrad:.1f} mrad{pixels}"
    return f'<td class="{level}" data-level="{level}">{pair.shared_s} s<br>{miss}<br>{light(level)}</td>'


def _clock(camera: CameraStatus) -> str:
    offset = "–" if camera.clock_offset_s is None else f"{1e3 * camera.clock_offset_s:+.1f} ms"
    return f'<td class="own">clock<br>{offset}</td>'


def check_table(status: StationStatus) -> str:
    """Everything that is watched, what is wrong first."""
    order = {"fail": 0, "warn": 1, "ok": 2}
    items = sorted(status.health.items, key=lambda item: order[item.level])
    rows = "".join(
        f'<tr class="{item.level}"><td>{light(item.level, CHECKS)}</td><th scope="row">{escape(item.name)}</th>'
        f"<td>{escape(item.reason)}</td><td>{escape(item.action) if item.level != 'ok' else ''}</td></tr>"
        for item in items
    )
    return f'<div class="scroll"><table class="checks"><tbody>{rows}</tbody></table></div>'


def camera_card(camera: CameraStatus, health: Health | None) -> str:
    """What is known of a camera, beside its picture."""
    level = "fail" if not camera.online else "warn" if camera.suspect or camera.muted else "ok"
    state = "silent" if not camera.online else "muted" if camera.muted else "left out" if camera.suspect else "sees"
    if level == "ok" and health is not None and health.level != "ok":
        level, state = "warn", "sees, but"
    counters = {} if health is None else health.counters
    items = {} if health is None else {item.name: item.reason for item in health.items}
    facts = {
        "last frame": "never" if camera.last_frame_s is None else f"{camera.last_frame_s:.1f} s ago",
        "clock": items.get("clock") or _bound(camera.clock_bound_s),
        "receiver": items.get("gnss", "none"),
        "version": "unknown" if health is None or not health.version else health.version,
        "objects a frame": f"{camera.detections_per_frame:.1f}",
        "frames lost": f"{camera.missed}",
        "focus (higher is sharper)": items.get("focus", "unknown"),
        "temperature": items.get("temperature", "unknown"),
        "dropped on the box": _counter(counters, "frames_dropped", "{:.0f}"),
    }
    reason = camera.suspect or camera.reason
    if not camera.online and camera.last_frame_s is not None:  # the station's own reason is up to a second older
        reason = f"last frame {camera.last_frame_s:.0f} s ago"
    own = "" if health is None else _items(health)
    lines = "".join(_fact(name, value) for name, value in facts.items())
    return (
        f'<div class="fact {level}" data-camera="{escape(camera.id)}" data-level="{level}">'
        f'<h3>{escape(camera.id)} <span class="light {level}">{state}</span></h3>'
        f"<p>{escape(reason)}</p>{own}<dl>{lines}</dl></div>"
    )


def _fact(name: str, value: str) -> str:
    wide = ' class="wide"' if name == "receiver" else ""  # a sentence, where the others are a number
    return f"<div{wide}><dt>{name}</dt><dd>{escape(value)}</dd></div>"


def _bound(bound_s: float | None) -> str:
    return "unknown" if bound_s is None else f"within {1e3 * bound_s:.2g} ms"


def _counter(counters: dict[str, float], name: str, form: str) -> str:
    return form.format(counters[name]) if name in counters else "unknown"


def _items(health: Health) -> str:
    wrong: Iterable[str] = (
        f"<li>{light(item.level, CHECKS)} {escape(item.name)}: {escape(item.reason)}. {escape(item.action)}</li>"
        for item in health.items
        if item.level != "ok"
    )
    text = "".join(wrong)
    return f'<ul class="items">{text}</ul>' if text else ""


def recording(status: StationStatus) -> str:
    """Whether it records, where, and how much room is left."""
    left = "" if status.free_mb is None else f", {status.free_mb / 1e3:.1f} GB left on the disk"
    if status.recording_folder is None:
        return f"<p>{light('warn')} Nothing can be recorded: set [recording] folder in the configuration.</p>"
    if status.recording is None:
        return f"<p>{light('warn')} Not recording{left}.</p>"
    return f"<p>{light('ok')} Recording to {escape(status.recording)}{left}.</p>"


def recordings(files: list[tuple[str, int]], chosen: str) -> str:
    """The recordings there are, newest first."""
    if not files:
        return "<p>There is no recording yet.</p>"
    rows = "".join(
        f'<li><a href="/recordings?name={quote(name)}"{" aria-current=true" if name == chosen else ""}>'
        f"{escape(name)}</a> {size / 1e6:.1f} MB</li>"
        for name, size in files
    )
    return f'<ul class="files">{rows}</ul>'
