"""What an installed version does without: a camera box runs from a small card, and every version is kept twice.

Only what nobody here ever loads, by name and with a reason: a library's own tests, headers, generators, a second copy
of what is already inside. No library is replaced, none of its licences removed. What debuggers read is cut off the
compiled files; the loader never looks at it.
"""

import os
import re
import struct
from pathlib import Path
from typing import Final

# Below site-packages. Each was measured on x86-64 with the versions in requirements.lock.
DROPPED: Final = (
    # the same code is inside onnxruntime_pybind11_state, which is what Python loads: 35 MB
    "onnxruntime/capi/libonnxruntime.so.*",
    "onnxruntime/tools",
    "onnxruntime/transformers",
    "onnxruntime/quantization",
    "onnxruntime/datasets",
    # only those tools of onnxruntime's read models apart: 3 MB
    "google",
    "protobuf-*",
    # every MAVLink dialect twice over; ours is calib's own, and `common` is what receivers are told with: 45 MB
    "pymavlink/dialects/v10",
    "pymavlink/dialects/v09",
    "pymavlink/dialects/v20/[!_c]*",
    "pymavlink/dialects/v20/c[!o]*",
    "pymavlink/message_definitions",
    # PDF and PostScript are never drawn, and only they take fonts apart (names of glyphs are read): 28 MB
    "fontTools/[!_am]*",
    "fontTools/merge",
    "fontTools/misc/*.so",
    # pictures of a format that nobody here reads or writes; Pillow does without: 5 MB
    "PIL/_avif*",
    "pillow.libs/libavif*",
    # colours for the text of programs, which the page shows none of: 3 MB
    "pygments/lexers/[!_ps]*",
    "pygments/lexers/_*_builtins.py",
    # the generator of dialects needs it: 12 MB
    "lxml",
    # a second implementation of the same, for PyPy: 12 MB
    "zstandard/_cffi*",
    # a faster event loop and a file watcher, which a page for a few operators does without: 15 MB
    "uvloop",
    "uvloop-*",
    "watchfiles",
    # compilers and generators
    "numpy/f2py/src",
    "numpy/_core/include",
    "numpy/_core/lib",
    "numpy/random/lib",
    "numpy/random/_examples",
    "nicegui/testing",
    # a compiler of style sheets for the browser, fetched only where a page brings some to compile: 3 MB
    "nicegui/static/sass*",
    "nicegui/static/immutable.es.js",
    # charts, editors and scenes that the page has not: 16 MB
    *(f"nicegui/elements/{name}/dist" for name in ("plotly", "mermaid", "codemirror", "echart", "json_editor")),
    *(f"nicegui/elements/{name}/dist" for name in ("aggrid", "scene", "xterm", "leaflet")),
    "matplotlib/mpl-data/sample_data",
    "matplotlib/mpl-data/fonts/afm",
    "matplotlib/mpl-data/fonts/pdfcorefonts",
    "**/tests",
    "**/*.a",
    "**/*.pyi",
    "**/*.pyx",
    "**/*.pxd",
    "**/*.c",
    "**/*.cpp",
    "**/*.h",
    "**/*.js.map",
)
KEPT: Final = ("pymavlink/dialects/v20/common.py",)


def _expression(pattern: str) -> str:
    """A pattern of path parts as a regular expression; `**` is any number of folders."""
    said = ""
    for part in re.findall(r"\*\*/|\*|\[!?[^\]]+\]|[^*\[]+", pattern):
        if part == "**/":
            said += "(?:[^/]+/)*"
        elif part == "*":
            said += "[^/]*"
        else:
            said += part.replace("[!", "[^") if part.startswith("[") else re.escape(part)
    return said


_DROPPED: Final = re.compile("|".join(f"(?:{_expression(pattern)})(?:/|$)" for pattern in DROPPED))


def dropped(name: str) -> bool:
    """Whether a file is left out, by its name below site-packages."""
    return name not in KEPT and "/licenses/" not in name and _DROPPED.match(name) is not None


def slim(packages: Path) -> int:
    """Remove it from a site-packages folder; bytes saved."""
    before = _size(packages)
    for folder, _, files in os.walk(packages, topdown=False):
        for file in files:
            if dropped(str((Path(folder) / file).relative_to(packages))):
                (Path(folder) / file).unlink()
        if folder != str(packages) and not any(Path(folder).iterdir()):
            Path(folder).rmdir()
    strip_all(packages)
    return before - _size(packages)


def strip_all(packages: Path) -> None:
    """Every compiled file of a site-packages folder."""
    for library in packages.rglob("*.so*"):
        strip(library)


def strip(file: Path) -> int:
    """Cut off a compiled file what follows the last byte that the loader maps; bytes saved.

    64-bit little-endian ELF only, others are left alone. The section table goes too: dlopen reads segments.
    """
    content = file.read_bytes()
    if content[:6] != b"\x7fELF\x02\x01":
        return 0
    table: int = struct.unpack_from("<Q", content, 32)[0]
    size, entries = struct.unpack_from("<HH", content, 54)
    end: int = table + size * entries
    for number in range(entries):
        offset, _, _, length = struct.unpack_from("<QQQQ", content, table + number * size + 8)
        end = max(end, offset + length)
    if end >= len(content):
        return 0
    header = bytearray(content[:64])
    struct.pack_into("<Q", header, 40, 0)
    struct.pack_into("<HHH", header, 58, 0, 0, 0)
    file.write_bytes(bytes(header) + content[64:end])
    return len(content) - end


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
