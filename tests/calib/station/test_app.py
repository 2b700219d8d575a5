"""The command line before any command: what has to hold before numpy is loaded."""

import os
import subprocess
import sys

PROGRAM = """
import sys
from calib.station.app import main
assert "numpy" not in sys.modules, "BLAS has counted its threads before it was told how many"
main(["simulate", "demo", "--output", sys.argv[1]])
assert "numpy" in sys.modules
import os
print(len(os.listdir("/proc/self/task")))
"""


def threads(folder: str, **environment: str) -> int:
    """How many threads the program has after it has computed something."""
    known = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, "-c", PROGRAM, folder]
    done = subprocess.run(command, env=known | environment, capture_output=True, text=True, check=True)
    return int(done.stdout.split()[-1])


def test_mathematics_is_done_by_one_thread(tmp_path: object) -> None:
    assert threads(str(tmp_path)) == 1


def test_whoever_wants_more_says_so(tmp_path: object) -> None:
    assert threads(str(tmp_path), OPENBLAS_NUM_THREADS="3") >= min(2, os.cpu_count() or 1)
