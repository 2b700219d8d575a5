"""How well any epipolar geometry explains two cameras' tracks, at every offset between their clocks at once.

The hazard is to look for a clock only where it is expected: the best place of a short search is believed, although the
true one lies an hour away. The eight-point system of two tracks is a sum of products of what one camera saw and what
the other saw a lag later, so over all lags it is a cross-correlation: one Fourier transform gives it for every lag at
which the two overlap, whatever their stamps say. Each system is normalised as Hartley (1997) does by its own rows,
because a piece of track that hardly moves would otherwise fit everything.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.solving.series import TrackSeries
from edge.common.arrays import Array

LAG_STEP_S: Final = 0.1  # between lags: a UAV that turns within a second is found from ten times as far
LONG_S: Final = 240.0  # tracks longer than this are read half as often, which keeps the cost of a pair bounded
SMALLEST_MISFIT: Final = 1e-24  # keeps the logarithm finite for noiseless tracks
SMALLEST_SPREAD: Final = 1e-12  # of a view's rows, squared: keeps the normalisation finite for one that stands still
# The six products of two of (x, y, 1), and where each of the nine lies among them.
PRODUCTS: Final = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
PLACE: Final = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


@dataclass(frozen=True)
class Sampled:
    """A track read at whole multiples of step_s.

    first: the multiple of the first row. rows: (N, 3) normalised rays and 1, zeros where nothing was seen. scale: what
    rays were multiplied with.
    """

    first: int
    step_s: float
    rows: Array
    scale: float


def sample(track: TrackSeries, step_s: float, rate: float = 0.0) -> Sampled:
    """A track with its stamps stretched by 1 + rate, read at multiples of step_s."""
    stretch = 1 + rate
    first = int(np.ceil(track.t_s[0] * stretch / step_s))
    last = max(int(np.floor(track.t_s[-1] * stretch / step_s)), first)
    rays = track.at(np.asarray(np.arange(first, last + 1) * (step_s / stretch), float))
    seen = np.isfinite(rays[:, 0])
    rows, scale = np.zeros((len(rays), 3)), 1.0
    if seen.any():
        middle = rays[seen].mean(0)
        scale = 1 / max(float(np.linalg.norm(rays[seen] - middle, axis=1).mean()), SMALLEST_SPREAD)
        rows[seen, :2], rows[seen, 2] = (rays[seen] - middle) * scale, 1.0
    return Sampled(first, step_s, rows, scale)


@dataclass(frozen=True)
class Correlation:
    """The products of two sampled tracks, transformed: systems at any lags are read off it."""

    one: Sampled
    two: Sampled
    products: Array

    @classmethod
    def of(cls, one: Sampled, two: Sampled) -> "Correlation":
        """Correlate two tracks sampled at the same step."""
        size = 1 << int(np.ceil(np.log2(len(one.rows) + len(two.rows))))
        first = np.fft.rfft(_products(one.rows), size).conj()
        second = np.fft.rfft(_products(two.rows), size)
        return cls(one, two, np.stack([np.fft.irfft(part * second, size) for part in first]))

    @property
    def lags(self) -> NDArray[np.int64]:
        """Every lag, in steps, that brings a row of the one onto a row of the other: to be added to two's stamps."""
        low = self.one.first - self.two.first - len(self.two.rows) + 1
        return np.arange(low, low + len(self.one.rows) + len(self.two.rows) - 1, dtype=np.int64)

    def overlap(self, lags: NDArray[np.int64]) -> Array:
        """(K,) rows that both saw at each lag (K,)."""
        rows: Array = np.round(self.products[5, 5, self._index(lags)])
        return rows

    def misfit(self, lags: NDArray[np.int64]) -> tuple[Array, Array]:
        """normalised_misfit of the systems at lags (K,)."""
        second, first = np.divmod(np.arange(9), 3)
        at = self.products[:, :, self._index(lags)]
        systems = np.moveaxis(at[PLACE[first[:, None], first[None]], PLACE[second[:, None], second[None]]], 2, 0)
        return normalised_misfit(systems, np.array([self.one.scale, self.two.scale]))

    def _index(self, lags: NDArray[np.int64]) -> NDArray[np.int64]:
        index: NDArray[np.int64] = (self.one.first - self.two.first - lags) % self.products.shape[2]
        return index


def _products(rows: Array) -> Array:
    return np.stack([rows[:, a] * rows[:, b] for a, b in PRODUCTS])


def normalised_misfit(systems: Array, scales: Array) -> tuple[Array, Array]:
    """Smallest eigenvalue a row (K,) of eight-point systems (K, 9, 9), each normalised by its own rows.

    scales: (2,) of the rays in them, first and second camera. Also (K, 2) what one ray unit is in each view then,
    squared. The systems' rows are products x2 x1 in the order (second, first), the last of them 1.
    """
    count = np.maximum(systems[:, 8, 8], 1.0)
    views, unit = [], []
    for (x, y), scale in zip(((6, 7), (2, 5)), scales, strict=True):
        mean_x, mean_y = systems[:, x, 8] / count, systems[:, y, 8] / count
        spread = (systems[:, x, x] + systems[:, y, y]) / count - mean_x**2 - mean_y**2
        zoom = np.sqrt(2 / np.maximum(spread, SMALLEST_SPREAD))
        view = np.zeros((len(systems), 3, 3))
        view[:, 0, 0] = view[:, 1, 1] = zoom
        view[:, 0, 2], view[:, 1, 2], view[:, 2, 2] = -zoom * mean_x, -zoom * mean_y, 1.0
        views.append(view)
        unit.append((zoom * scale) ** 2)
    both = np.einsum("kij,klm->kiljm", views[1], views[0]).reshape(-1, 9, 9)
    smallest = np.linalg.eigvalsh(both @ systems @ both.transpose(0, 2, 1))[:, 0] / count
    return np.maximum(smallest, SMALLEST_MISFIT), np.stack(unit, axis=1)
