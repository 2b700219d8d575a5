"""What a receiver at rest can know at best: for the box that averages it and the base that combines occupations."""

from typing import Final

# East, north, up: no receiver on a tripod does better, whatever it says.
LEAST_STATIC_SIGMA_M: Final = (0.004, 0.004, 0.008)
