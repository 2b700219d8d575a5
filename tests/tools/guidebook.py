"""The guide as tests read it."""

import re
from typing import Final

from tools.guide import GUIDE

TEXT: Final = GUIDE.read_text()


def blocks(language: str) -> list[str]:
    """The texts of its code blocks in one language: `sh` runs anywhere, `console` needs hardware."""
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
