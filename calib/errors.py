"""The calibration's part of the exception tree (drawn in edge/common/errors.py).

`edge.lens` is the one module of `edge` that the mathematics may import, so the tree's root reaches us through it.
"""

from edge.common.errors import LensError, SkyfixError

__all__ = ["CalibrationError", "LensError", "SkyfixError"]


class CalibrationError(SkyfixError):
    """The observations do not determine what was asked for."""


class ContradictionError(CalibrationError):
    """What is claimed of the site contradicts itself, and why is known: no other beginning would mend it."""


class UndeterminedError(CalibrationError):
    """What was seen leaves the network open."""
