"""What a kind of trouble is: a name, how it is drawn, and whether it is none."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tools.doubles.hazards.brought import Brought


@dataclass(frozen=True)
class Kind:
    """healthy: it must be solved, and nobody named."""

    name: str
    draw: Callable[[np.random.Generator], Brought]
    healthy: bool = False
