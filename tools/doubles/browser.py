"""Debian's chromium, led by playwright, without a screen and without a word to anybody but the page it is given."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

# A browser asks the internet for updates, components and lists by itself; a test that watches whom a page asks, or a
# machine without a network, must not see that. Root, as in a container, has no sandbox.
QUIET: Final = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@contextmanager
def browser() -> Iterator[Any]:
    """A running browser. Raises FileNotFoundError where chromium is not installed."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 -- of the extra `test`; benches do without

    program = shutil.which("chromium")
    if program is None:
        raise FileNotFoundError("chromium is not installed (Debian package chromium)")
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=program, args=list(QUIET))
        try:
            yield opened
        finally:
            opened.close()
