"""Where tests find what is not theirs: the checkout, and the recordings beside it, which may be absent."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
DEPLOY: Final = ROOT / "deploy"
DATA: Final = ROOT.parent / "shared" / "data"
