"""What the installer says: one line each, and refusals that name what to do."""

import sys


class RefusedError(Exception):
    """It cannot be done. what: the fault, with its numbers; action: what to do; code: of the program's end."""

    def __init__(self, what: str, action: str, code: int = 1) -> None:
        super().__init__(f"{what}; {action}")
        self.code = code


def say(what: str) -> None:
    """One line for whoever sits there."""
    print(f"skyfix: {what}", flush=True)


def warn(what: str) -> None:
    """One line that asks for something."""
    print(f"skyfix: WARN {what}", file=sys.stderr, flush=True)
