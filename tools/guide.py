"""Write the tables of deploy/GUIDE.md that come from the program: every key, every message, the predicted error.

    python -m tools.guide           write them
    python -m tools.guide --check   say whether the guide is out of date, exit 1 if it is

What stands between `<!-- NAME -->` and `<!-- end -->` is generated; the rest is written by hand.
"""

import argparse
import ast
import inspect
import io
import re
import sys
import textwrap
import tokenize
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from calib.adjustment.projection import CAMERA_SIZE, CENTRE, ROTATION
from calib.network import Camera
from calib.solving.prediction import predict
from calib.station.config import BaseConfig
from edge.common.arrays import Array
from edge.config import BoxConfig
from edge.lens import LensModel
from edge.messages import MESSAGES, Backlog, Inventory

GUIDE: Final = Path(__file__).parents[1] / "deploy" / "GUIDE.md"

# The table of predicted errors: what good practice reaches.
FOCAL_PX: Final = 1660.0  # Full HD over 60 degrees
SIGMA_PX: Final = 1.0  # a small detector on a small object
SIGMA_ATTITUDE_RAD: Final = 3e-4  # of a calibration from some minutes of flight
SIGMA_CENTRE_M: Final = 0.03  # RTK, two occupations
BASELINES_M: Final = (25.0, 50.0, 100.0, 200.0)
DISTANCES_M: Final = (50.0, 100.0, 300.0, 1000.0)
ELEVATION_DEG: Final = 30.0


def keys(kind: type[msgspec.Struct], path: str = "") -> Iterator[tuple[str, type[msgspec.Struct]]]:
    """The tables of a configuration, in TOML's words, each with its struct."""
    yield path, kind
    for name, hint in get_type_hints(kind).items():
        for section in _structs(hint):
            yield from keys(section, f"{path}.{name}".lstrip("."))


def _structs(hint: Any) -> list[type[msgspec.Struct]]:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return [hint]
    return [found for part in get_args(hint) for found in _structs(part)]


def configuration(kind: type[msgspec.Struct]) -> str:
    """A Markdown table for every section of a configuration."""
    parts = []
    for path, section in keys(kind):
        heading = f"`[{path}]`" if path else "At the top of the file"
        about = inspect.getdoc(section) or ""
        rows = "".join(_row(section, field) for field in msgspec.structs.fields(section) if not _structs(field.type))
        table = f"| key | allowed | default | |\n|---|---|---|---|\n{rows}" if rows else ""
        parts.append(f"**{heading}** {' '.join(about.split())}\n\n{table}")
    return "\n".join(parts)


def _row(section: type[msgspec.Struct], field: msgspec.structs.FieldInfo) -> str:
    hint = get_type_hints(section, include_extras=True)[field.name]
    said = _description(hint) or _comments(section).get(field.name, "")
    return f"| `{field.name}` | {_allowed(hint)} | {_default(field)} | {_cell(said)} |\n"


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.default_factory is not msgspec.NODEFAULT:
        return f"`{field.default_factory()}`"
    if field.default is msgspec.NODEFAULT:
        return "**needed**"
    return "–" if field.default is None else f"`{_plain(field.default)}`"


def _plain(value: object) -> str:
    """A default as TOML has it; a file of the program by its name, wherever it is installed."""
    if isinstance(value, Path) or (isinstance(value, str) and value.startswith(str(GUIDE.parents[1]))):
        return Path(value).name
    return str(value).lower() if isinstance(value, bool) else str(value)


def _description(hint: Any) -> str:
    if get_origin(hint) is Annotated:
        for meta in get_args(hint)[1:]:
            if isinstance(meta, msgspec.Meta) and meta.description:
                return meta.description
    return next((found for part in get_args(hint) if (found := _description(part))), "")


def _comments(section: type[msgspec.Struct]) -> dict[str, str]:
    """What the comments beside the fields say."""
    found: dict[str, str] = {}
    for owner in reversed(section.__mro__):
        if owner.__module__.partition(".")[0] not in ("edge", "calib"):
            continue
        source = textwrap.dedent(inspect.getsource(owner))
        comments = {
            token.start[0]: token.string.lstrip("# ")
            for token in tokenize.generate_tokens(io.StringIO(source).readline)
            if token.type == tokenize.COMMENT
        }
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                lines = range(node.lineno, (node.end_lineno or node.lineno) + 1)
                found[node.target.id] = " ".join(comments[line] for line in lines if line in comments)
    return found


def _allowed(hint: Any) -> str:
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        bounds = " ".join(filter(None, (_bounds(meta) for meta in parts[1:] if isinstance(meta, msgspec.Meta))))
        return f"{_allowed(parts[0])} {bounds}".strip()
    if origin in (Union, types.UnionType):
        return " or ".join(_allowed(part) for part in parts if part is not type(None))
    if origin is Literal:
        return ", ".join(f'`"{part}"`' for part in parts)
    if origin in (list, tuple):
        inner = [_allowed(part) for part in parts if part is not Ellipsis]
        return f"list of {inner[0]}" if origin is list or Ellipsis in parts else f"{len(inner)} × {inner[0]}"
    names = {str: "text", int: "whole number", float: "number", bool: "true, false", Path: "path"}
    return names.get(hint, _cell(getattr(hint, "__name__", str(hint))))


def _bounds(meta: msgspec.Meta) -> str:
    low = f"≥ {meta.ge:g}" if meta.ge is not None else f"> {meta.gt:g}" if meta.gt is not None else ""
    high = f"≤ {meta.le:g}" if meta.le is not None else f"< {meta.lt:g}" if meta.lt is not None else ""
    return ", ".join(filter(None, (low, high)))


def _cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|").strip()


def messages() -> str:
    """Every message on Zenoh: key, fields, what it says."""
    kinds: list[tuple[str, type[msgspec.Struct]]] = [*MESSAGES.items()]
    kinds += [("cam/backlog", Inventory), ("cam/backlog", Backlog)]
    rows = []
    for topic, kind in kinds:
        who, name = topic.split("/")
        place = f"cam/<camera>/{name}" if who == "cam" else f"station/{name}"
        about = _cell(inspect.getdoc(kind) or "")
        fields = ", ".join(f"`{field.name}`" for field in msgspec.structs.fields(kind))
        rows.append(f"| `{place}` | [{kind.__name__}](schema/{kind.__name__}.json) | {about} | {fields} |\n")
    head = "| key below `skyfix/1/<site>/` | message | | fields |\n|---|---|---|---|\n"
    return head + "".join(rows)


def predicted() -> str:
    """One sigma in 3D (m) for three cameras in a triangle, by its side and the object's distance."""
    lines = ["| side of the triangle | " + " | ".join(f"at {d:.0f} m" for d in DISTANCES_M) + " |\n"]
    lines.append("|---" * (len(DISTANCES_M) + 1) + "|\n")
    for side_m in BASELINES_M:
        cells = " | ".join(f"{_sigma_m(side_m, distance_m):.2g} m" for distance_m in DISTANCES_M)
        lines.append(f"| {side_m:.0f} m | {cells} |\n")
    return "".join(lines)


def _sigma_m(side_m: float, distance_m: float) -> float:
    """Mean over the directions, of an object at ELEVATION_DEG that all three cameras look at."""
    sigma = np.zeros(CAMERA_SIZE)
    sigma[ROTATION], sigma[CENTRE] = SIGMA_ATTITUDE_RAD, SIGMA_CENTRE_M
    covariance = np.diag(np.tile(sigma**2, 3))
    elevation = np.radians(ELEVATION_DEG)
    found = []
    for azimuth in np.radians(np.arange(0.0, 360.0, 30.0)):
        flat = np.array([np.sin(azimuth), np.cos(azimuth)]) * np.cos(elevation)
        point = distance_m * np.array([*flat, np.sin(elevation)])
        corners = 2 * np.pi * np.arange(3) / 3
        centres = side_m / np.sqrt(3) * np.column_stack([np.sin(corners), np.cos(corners), np.zeros(3)])
        cameras = tuple(_looking(f"cam{k}", centre, point) for k, centre in enumerate(centres))
        found.append(predict(cameras, np.full(3, SIGMA_PX), covariance, point[None]).sigma_m[0])
    return float(np.sqrt(np.mean(np.square(found))))


def _looking(name: str, centre: Array, at: Array) -> Camera:
    forward = (at - centre) / np.linalg.norm(at - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    lens = LensModel("radtan", (FOCAL_PX, FOCAL_PX, 959.5, 539.5), (0.0,) * 5, (1920, 1080))
    return Camera(name, lens, np.array([right, np.cross(forward, right), forward]), centre)


PARTS: Final[dict[str, Callable[[], str]]] = {
    "keys of edge-node": lambda: configuration(BoxConfig),
    "keys of base-station": lambda: configuration(BaseConfig),
    "messages": messages,
    "predicted error": predicted,
}


def filled(text: str) -> str:
    """The guide with its generated parts as they are now. Raises ValueError if a place for one is missing."""
    for name, make in PARTS.items():
        place = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
        if len(place.findall(text)) != 1:
            raise ValueError(f"deploy/GUIDE.md needs one <!-- {name} --> ... <!-- end -->")
        begin, end = place.sub(r"\1\0\2", text).split("\0")
        text = f"{begin}\n{make()}\n{end}"
    return text


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Write the generated tables of deploy/GUIDE.md.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if the guide is out of date")
    check = parser.parse_args().check
    text = GUIDE.read_text()
    new = filled(text)
    if check:
        print("up to date" if new == text else "deploy/GUIDE.md is out of date: run `python -m tools.guide`")
        return int(new != text)
    GUIDE.write_text(new)
    print(f"wrote {GUIDE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
