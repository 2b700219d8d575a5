"""The array types that signatures name. One alias, so that a shape's element type is said the same way everywhere."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
