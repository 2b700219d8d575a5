"""What flights are looked for when a new target is: straight ones for long, and hard turns for a moment.

The hazard is the flight that is not straight for a second. A racing drone turns by sixty degrees meanwhile, and a
search for straight lines alone never finds it; one that allows such turns for a second finds them in any clutter. So
what has not become a target as a straight flight is looked at again, as a turn, for half of the time.
"""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Search:
    """span_s: of rays looked at. degree: of a bearing over time. sigma_m_s2: acceleration an axis, None: as expected.

    jerk_m_s3: by how much the acceleration may change within the span.
    """

    span_s: float
    degree: int
    sigma_m_s2: float | None = None
    jerk_m_s3: float = 0.0


STRAIGHT: Final = Search(0.8, 1)
# 5 g, 40 m/s on a circle of 30 m: 52 m/s2 that turn by 1.3 rad/s. In 0.4 s a camera of 15 Hz has six rays of it.
TURNING: Final = Search(0.4, 2, 30.0, 70.0)
SEARCHES: Final = (STRAIGHT, TURNING)
