"""The calibration's part of the exception tree (drawn in edge/common/errors.py).

`edge.lens` is the one module of `edge` that the mathematics may import, so the tree's root reaches us through it.
"""

from edge.common.errors import LensError, SkyfixError

__all__ = ["CalibrationError", "LensError", "SkyfixError"]


class CalibrationError(SkyfixError):
    """The observations do not determine what was asked for."""
