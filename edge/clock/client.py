"""Asking a time daemon through its own client, which answers in milliseconds or not at all."""

import subprocess
from typing import Final

ASK_TIMEOUT_S: Final = 2.0


def ask(*command: str) -> str | None:
    """What a time daemon's client prints; None if it is not installed, fails or does not answer."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=ASK_TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None
