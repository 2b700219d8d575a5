"""Write the JSON Schema of every message and of every configuration file to deploy/schema.

    python -m tools.schema          write them
    python -m tools.schema --check  say which are out of date, exit 1 if any is

Those of messages are for programs that talk to Skyfix in another language; those of configuration files for editors,
which complete keys, show what they mean and mark what is not allowed (the `#:schema` line at the top of the examples).
All are generated from the structs and never edited; a test holds that they agree.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

import msgspec

from calib.station.commands.router import RouterConfig
from calib.station.config import BaseConfig
from edge.config import BoxConfig, LensConfig
from edge.detector.mask_file import MaskConfig
from edge.messages import MESSAGES, VERSION, Backlog, Inventory, json_schema

FOLDER: Final = Path(__file__).parents[1] / "deploy" / "schema"
CONFIGURATIONS: Final[dict[str, type[msgspec.Struct]]] = {
    "edge.toml": BoxConfig,
    "base.toml": BaseConfig,
    "router.toml": RouterConfig,
    "lens.toml": LensConfig,
    "mask.toml": MaskConfig,
}


def schemas() -> dict[str, str]:
    """The text of every schema file, by file name."""
    messages: set[type[msgspec.Struct]] = {*MESSAGES.values(), Backlog, Inventory}
    named = {f"{VERSION}/{kind.__name__}": kind for kind in messages} | CONFIGURATIONS
    return {f"{name.rpartition('/')[2]}.json": _text(name, kind) for name, kind in sorted(named.items())}


def _text(name: str, kind: type[msgspec.Struct]) -> str:
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"skyfix/{name}.json"}
    return msgspec.json.format(msgspec.json.encode(schema | json_schema(kind)), indent=2).decode() + "\n"


def out_of_date(folder: Path) -> list[str]:
    """Names of files that are missing, different or left over."""
    wanted = schemas()
    there = {file.name: file.read_text() for file in folder.glob("*.json")}
    return sorted(name for name in wanted.keys() | there.keys() if wanted.get(name) != there.get(name))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description="Write the JSON Schema of messages and configuration files to deploy/schema."
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if a file is out of date")
    if parser.parse_args().check:
        stale = out_of_date(FOLDER)
        print("\n".join(f"{name} is out of date: run `python -m tools.schema`" for name in stale) or "all up to date")
        return 1 if stale else 0
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in {file.name for file in FOLDER.glob("*.json")} - schemas().keys():
        (FOLDER / name).unlink()
    for name, text in schemas().items():
        (FOLDER / name).write_text(text)
    print(f"wrote {len(schemas())} schemas to {FOLDER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
