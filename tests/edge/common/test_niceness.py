"""Stepping back where it is allowed, and going on where it is not."""

import subprocess
import sys

from tests.places import ROOT

STEP_BACK = "import os, logging; logging.basicConfig(); from edge.common.niceness import step_back; "


def said(script: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)


def test_a_process_steps_back() -> None:
    assert said(STEP_BACK + "before = os.nice(0); print(step_back(3), os.nice(0) - before)").stdout.split() == [
        "True",
        "3",
    ]


def test_a_forbidden_step_is_told_and_survived() -> None:
    done = said(f"from tests.forbidden import forbid; forbid('setpriority'); {STEP_BACK} print(step_back(3))")
    assert done.stdout.split() == ["False"]
    assert "setpriority" in done.stderr
    assert "Operation not permitted" in done.stderr
