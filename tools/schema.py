"""Write the JSON Schema of every message to deploy/schema, for those who talk to Skyfix in another language.

    python -m tools.schema          write them
    python -m tools.schema --check  say which are out of date, exit 1 if any is

The schemas are generated from the structs in edge/messages.py and never edited; a test holds that they agree.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

import msgspec

from edge.messages import MESSAGES, VERSION, Backlog, Inventory, json_schema

FOLDER: Final = Path(__file__).parents[1] / "deploy" / "schema"


def schemas() -> dict[str, str]:
    """The text of every schema file, by file name."""
    kinds: set[type[msgspec.Struct]] = {*MESSAGES.values(), Backlog, Inventory}
    return {f"{kind.__name__}.json": _text(kind) for kind in sorted(kinds, key=lambda kind: kind.__name__)}


def _text(kind: type[msgspec.Struct]) -> str:
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"skyfix/{VERSION}/{kind.__name__}.json",
    }
    return msgspec.json.format(msgspec.json.encode(schema | json_schema(kind)), indent=2).decode() + "\n"


def out_of_date(folder: Path) -> list[str]:
    """Names of files that are missing, different or left over."""
    wanted = schemas()
    there = {file.name: file.read_text() for file in folder.glob("*.json")}
    return sorted(name for name in wanted.keys() | there.keys() if wanted.get(name) != there.get(name))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Write the JSON Schema of every message to deploy/schema.")
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
