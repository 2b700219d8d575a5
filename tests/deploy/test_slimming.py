"""What an installed version does without still leaves what is loaded, whole."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from deploy.installer.slimming import slim, strip
from tests.places import ROOT


def test_a_stripped_library_still_loads(tmp_path: Path) -> None:
    """The most that is cut off anything here: numpy's own generators, with their symbols."""
    source = next((Path(np.__file__).parent / "random").glob("_mt19937*.so"))
    copy = tmp_path / source.name
    shutil.copyfile(source, copy)
    with copy.open("ab") as file:
        file.write(b"symbols" * 1000)  # a distribution may have stripped it: then there is this to cut
    assert strip(copy) >= 7000
    assert strip(copy) == 0
    load = "import ctypes, sys; ctypes.CDLL(sys.argv[1])"
    subprocess.run([sys.executable, "-c", load, str(copy)], check=True)


@pytest.mark.parametrize("content", [b"", b"\x7fELF\x01\x01" + bytes(100), b"#!/bin/sh\n" * 20])
def test_what_is_no_64_bit_library_is_left_alone(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "file.so").write_bytes(content)
    assert strip(tmp_path / "file.so") == 0
    assert (tmp_path / "file.so").read_bytes() == content


def test_licences_and_our_dialect_stay(tmp_path: Path) -> None:
    kept = [
        "pymavlink/dialects/v20/common.py",
        "pymavlink/dialects/v20/__init__.py",
        "numpy-2.dist-info/licenses/numpy/random/lib/LICENSE.h",
        "edge/models/skyfix.onnx",
        "numpy/f2py/__init__.py",  # numpy's own __getattr__ loads it for whoever lists its names: scipy does
        "PIL/_imaging.so",
        "pygments/lexers/_mapping.py",
        "pygments/lexers/special.py",
        "onnxruntime/capi/onnxruntime_pybind11_state.so",
    ]
    gone = [
        "pymavlink/dialects/v20/ardupilotmega.py",
        "pymavlink/dialects/v20/cubepilot.py",
        "pymavlink/dialects/v10/common.py",
        "scipy/stats/tests/test_x.py",
        "google/protobuf/message.py",
        "PIL/_avif.so",
        "nicegui/static/sass.dart.js",
        "pygments/lexers/matlab.py",
        "pygments/lexers/_lasso_builtins.py",
        "pillow.libs/libavif-1.so.16",
        "onnxruntime/capi/libonnxruntime.so.1.2",
    ]
    for name in [*kept, *gone]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("text")
    assert slim(tmp_path) == 4 * len(gone)
    assert [name for name in kept if not (tmp_path / name).exists()] == []
    assert [name for name in gone if (tmp_path / name).exists()] == []


@pytest.mark.parametrize(
    "word", ["add_sass", "add_scss", "ui.markdown", "ui.code", "ui.mermaid", "ui.plotly", "ui.echart"]
)
def test_the_page_asks_for_nothing_that_is_left_out(word: str) -> None:
    assert [file for file in (ROOT / "calib/station/page").rglob("*.py") if word in file.read_text()] == []
