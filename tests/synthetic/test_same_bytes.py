"""The same recording gives the same bytes, in this process and in another."""

import hashlib
import subprocess
import sys

from calib.network import to_toml
from tests.calib.flights import site
from tests.synthetic.solving import solved

DESCRIPTION = site(offsets_s=(0.0, 0.4, 0.0, 0.0), each={"outlier": 0.1, "clutter_per_frame": 0.1})


def digest() -> str:
    """Everything a solution says, as one number."""
    solution = solved(DESCRIPTION).solution
    arrays = (solution.trajectory.points_enu, solution.trajectory.covariance_enu, solution.trajectory.t_unix_ns)
    text = to_toml(solution.network) + repr(solution.report.findings)
    return hashlib.sha256(text.encode() + b"".join(array.tobytes() for array in arrays)).hexdigest()


def test_same_input_same_bytes() -> None:
    other = subprocess.run(
        [sys.executable, "-c", "from tests.synthetic.test_same_bytes import digest; print(digest())"],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    assert digest() == digest() == other.stdout.strip()
