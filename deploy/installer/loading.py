"""Run by the version's own Python: load all of ours that can be loaded here, and all that it loads only later.

What does not load is said before anything is changed, and what was loaded is compiled: the services cannot write there.
A library that belongs to another role is no fault; a part of one that is there is.
"""

import ast
import importlib
import importlib.util
import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path

TOLD = 3  # of the faults


def main() -> int:
    """Load them; 1, with the first faults, if something does not."""
    faults = {name: fault for name in dict.fromkeys(_names()) if (fault := _fault(name))}
    told = [f"{name}: {fault}" for name, fault in list(faults.items())[:TOLD]]
    print("; ".join(told + [f"and {len(faults) - TOLD} more"] * (len(faults) > TOLD)), file=sys.stderr)
    return int(bool(faults))


def _names() -> Iterator[str]:
    for room in ("edge", "calib"):
        yield room
        folder = str(Path(importlib.util.find_spec(room).origin).parent)  # type: ignore[union-attr,arg-type]
        for module in pkgutil.walk_packages([folder], f"{room}."):
            if not module.name.endswith("__main__"):
                yield module.name
            if not module.ispkg:
                yield from _imported(Path(folder).parent / (module.name.replace(".", "/") + ".py"))


def _imported(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (each.name for each in node.names)


def _fault(name: str) -> str:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        library = (error.name or "").split(".")[0]
        absent = library not in ("", "edge", "calib") and importlib.util.find_spec(library) is None
        return "" if absent else str(error)
    except Exception as error:  # noqa: BLE001 -- whatever it is, it is told
        return f"{type(error).__name__}: {error}"
    return ""


if __name__ == "__main__":
    sys.exit(main())
