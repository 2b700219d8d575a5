"""Write the tables of deploy/GUIDE.md that come from the program: every key, every message, the predicted error.

    python -m tools.guide           write them
    python -m tools.guide --check   say whether the guide is out of date, exit 1 if it is

What stands between `<!-- NAME -->` and `<!-- end -->` is generated; the rest is written by hand.
"""

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from msgspec import inspect

from calib.adjustment.projection import CAMERA_SIZE, CENTRE, ROTATION
from calib.network import Camera
from calib.solving.prediction import predict
from calib.station.config import BaseConfig
from edge.common import settings
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


def tables(kind: type[msgspec.Struct]) -> Iterator[tuple[str, inspect.StructType]]:
    """The tables of a configuration, in TOML's words, each with its type."""
    yield from _tables("", inspect.type_info(kind))


def _tables(path: str, kind: inspect.Type) -> Iterator[tuple[str, inspect.StructType]]:
    for section in _structs(kind):
        yield path, section
        for field in section.fields:
            yield from _tables(f"{path}.{field.encode_name}".lstrip("."), field.type)


def _structs(kind: inspect.Type) -> list[inspect.StructType]:
    """The tables a key may hold: itself, or one of several, or each of a list."""
    if isinstance(kind, inspect.StructType):
        return [kind]
    if isinstance(kind, inspect.Metadata):
        return _structs(kind.type)
    if isinstance(kind, inspect.UnionType):
        return [found for option in kind.types for found in _structs(option)]
    return _structs(kind.item_type) if isinstance(kind, inspect.ListType | inspect.VarTupleType) else []


def keys(section: inspect.StructType) -> list[inspect.Field]:
    """The keys of a table that are no tables themselves."""
    return [field for field in section.fields if not _structs(field.type)]


def configuration(kind: type[msgspec.Struct]) -> str:
    """A Markdown table for every section of a configuration."""
    parts = []
    for path, section in tables(kind):
        heading = f"`[{path}]`" if path else "At the top of the file"
        rows = "".join(map(_row, keys(section)))
        table = f"| key | allowed | default | |\n|---|---|---|---|\n{rows}" if rows else ""
        parts.append(f"**{heading}** {settings.description(section)}\n\n{table}")
    return "\n".join(parts)


def _row(field: inspect.Field) -> str:
    allowed = _cell(settings.allowed(field.type))
    return f"| `{field.encode_name}` | {allowed} | {_default(field)} | {_cell(settings.description(field.type))} |\n"


def _default(field: inspect.Field) -> str:
    if field.required:
        return "**needed**"
    value = field.default_factory() if field.default is msgspec.NODEFAULT else field.default
    return "–" if value is None else f"`{json.dumps(value)}`"


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
        about = _cell(settings.description(inspect.type_info(kind)))
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
