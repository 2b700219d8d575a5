"""What a measurement of a lens found, as text to read and as a lens file.

A fit says nothing of the corners of the image that no board reached, and looks no worse for it. So the report draws
where corners were seen, and names every picture that was left out.
"""

from typing import Final

import msgspec
import numpy as np
import tomli_w

from edge.config import LensConfig
from edge.lens_fit.fit import LensFit

EMPTY_CELLS_WARN: Final = 0.35  # share of the image without a corner beyond which the lens is guessed there
SHADES: Final = " .:+#"  # coverage, from none to plenty
PLENTY: Final = 16  # corners in a cell
PROVENANCE: Final = "# Written by `edge-node lens`.\n"
LEAST_FOCAL_SIGMA_PX: Final = 1e-3  # a board rendered without noise has less, and the reader wants more than 0


def report(fit: LensFit, missed: dict[str, str]) -> str:
    """What was found, in words and a map."""
    fx, fy, cx, cy = fit.lens.intrinsics
    lines = [
        f"{fit.lens.model} lens, {fit.lens.size_px[0]} x {fit.lens.size_px[1]}, from {len(fit.view_rms_px)} pictures",
        f"focal length {fx:.2f}, {fy:.2f} px, one sigma {fit.lens.focal_sigma_px:.2f} px; centre {cx:.2f}, {cy:.2f} px",
        f"distortion {', '.join(f'{value:.6f}' for value in fit.lens.distortion)}",
        f"rms {fit.rms_px:.3f} px; of pictures held out {fit.held_out_rms_px:.3f} px",
    ]
    lines += [f"left out: {name}: {reason}" for name, reason in {**missed, **fit.rejected}.items()]
    lines.append(f"corners seen in {np.mean(fit.coverage > 0):.0%} of the image:")
    lines += ["  |" + "".join(_shade(count) * 2 for count in row) + "|" for row in fit.coverage]
    if np.mean(fit.coverage == 0) > EMPTY_CELLS_WARN:
        lines.append("WARN the empty parts are extrapolated: take pictures with the board there")
    return "\n".join(lines)


def _shade(count: float) -> str:
    return SHADES[min(len(SHADES) - 1, int(np.ceil(count / PLENTY * (len(SHADES) - 1))))]


def lens_toml(fit: LensFit, missed: dict[str, str]) -> str:
    """The lens file: the table that the configuration reads, and how it came about."""
    lens = fit.lens
    fx, fy, cx, cy = map(_rounded, lens.intrinsics)
    table = LensConfig(
        model=lens.model,
        intrinsics=(fx, fy, cx, cy),
        distortion=tuple(map(_rounded, lens.distortion)),
        size_px=lens.size_px,
        rms_px=round(fit.rms_px, 4),
        focal_sigma_px=round(max(lens.focal_sigma_px or 0.0, LEAST_FOCAL_SIGMA_PX), 4),
        report={
            "pictures": len(fit.view_rms_px),
            "held_out_rms_px": round(fit.held_out_rms_px, 4),
            "coverage": round(float(np.mean(fit.coverage > 0)), 3),
            "left_out": {**missed, **fit.rejected},
            "view_rms_px": {name: round(rms, 4) for name, rms in fit.view_rms_px.items()},
        },
    )
    return PROVENANCE + tomli_w.dumps(msgspec.to_builtins(table))


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")
