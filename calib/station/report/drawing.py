"""A matplotlib figure as SVG text that can stand inside an HTML page: same input, same bytes, no request.

The hazard is the library's own zeal: it writes the date into every file, draws identifiers at random, and its state is
global. Figures here are made without pyplot, under settings of our own, and their text stays text.
"""

import io
from collections.abc import Callable
from typing import Any, Final

# Okabe and Ito (2008): told apart by colour-blind people too.
COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8a7f00")
INK: Final = "#1d2733"
FAINT: Final = "#c9d1d9"
SETTINGS: Final = {
    "svg.hashsalt": "skyfix",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": "#8b98a5",
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6eaee",
    "xtick.color": INK,
    "ytick.color": INK,
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
}


def draw(width_in: float, height_in: float, paint: Callable[[Any], None]) -> str:
    """The SVG element of a figure. paint: draws on the matplotlib Figure it is given."""
    import matplotlib as mpl  # noqa: PLC0415 -- half a second that only who writes a report shall pay
    from matplotlib.backends.backend_svg import FigureCanvasSVG  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasSVG(figure)
        paint(figure)
        target = io.StringIO()
        figure.savefig(target, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    text = target.getvalue()
    return text[text.index("<svg") :].rstrip()


def colour(index: int) -> str:
    """The colour of the index-th camera or track."""
    return COLOURS[index % len(COLOURS)]
