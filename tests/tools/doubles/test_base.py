"""The configuration that benches and tests start a base with is one that the program accepts."""

from pathlib import Path

import pytest

from calib.station import config
from tools.doubles.base import NOBODY, Base, base_config


def test_own_sections_are_laid_over_the_usual_ones_and_the_program_accepts_them(tmp_path: Path) -> None:
    own = {"site": {"undulation_m": 47.0}, "mavlink": {"endpoint": [NOBODY]}, "status": {"page": True}}
    base = Base(tmp_path, base_config("field", ["cam0", "cam1", "cam2"], "tcp/127.0.0.1:7447", **own))
    read = config.load(base.file)
    assert (read.site.name, read.site.undulation_m) == ("field", 47.0)
    assert [camera.id for camera in read.camera] == ["cam0", "cam1", "cam2"]
    assert read.link.listen == ("tcp/127.0.0.1:7447",)
    assert (read.status.page, read.recording.min_free_mb) == (True, 1)


def test_a_base_that_was_never_started_has_no_process_and_no_status(tmp_path: Path) -> None:
    base = Base(tmp_path, base_config("field", [], "tcp/127.0.0.1:7447"))
    assert base.status() == {}
    base.kill()
    with pytest.raises(RuntimeError, match="never started"):
        base.stop()
