"""Modules that only Debian packages carry: bindings of cameras' libraries, which no package index has.

The hazard is the search path. Debian's folder put first would replace this environment's own numpy by another; so it
comes last, and only while such a module is loaded.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

DEBIAN_PYTHON: Final = "/usr/lib/python3/dist-packages"


@contextmanager
def debian_modules() -> Iterator[None]:
    """Within it, what is not found here is looked for among Debian's packages."""
    sys.path.append(DEBIAN_PYTHON)
    try:
        yield
    finally:
        sys.path.remove(DEBIAN_PYTHON)
