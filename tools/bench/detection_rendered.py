"""Centre error and honesty of sigma on rendered scenes: `python -m tools.bench.detection_rendered`.

Seeds are those that training never draws (tools/train/rendered.py). Every scene is seen raw and through the codec of
`tools/render`, and by the model as the box runs it: in 64 px crops about where the object is, give or take.
"""

import argparse
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np

from edge.config import SHIPPED_MODEL
from edge.detector.session import open_model
from edge.detector.skyfix import StackNet
from tools.detection_scores import Floats
from tools.render import CODEC
from tools.train.rendered import FIRST_TEST_SEED, centred_crops

WIDTHS_PX: Final = (3.0, 4.0, 6.0, 8.0, 16.0, 32.0)
CROP_PX: Final = 64
SCORE: Final = 0.25  # the box's own threshold
OTHER_PX: Final = 4.0  # at least: a detection further off is something else


@dataclass
class Tally:
    """What was found of objects of one width: errors `(2,)` px, sigmas px, and how many there were to find."""

    errors: list[Floats] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    objects: int = 0
    false: int = 0

    def line(self) -> str:
        """Recall, false ones, rms a coordinate, rms distance, rms of error over sigma."""
        error, sigma = np.array(self.errors).reshape(-1, 2), np.array(self.sigmas)
        if not len(error):
            return f"recall 0 of {self.objects}"
        rms = np.sqrt(np.mean(error**2))
        ratio = error / sigma[:, None]
        normalised, inside = np.sqrt(np.mean(ratio**2)), np.mean(np.abs(ratio) < 1)
        return (
            f"recall {len(error) / self.objects:.3f}  false/crop {self.false / self.objects:.3f}  "
            f"rms {rms:.3f} px a coordinate, {rms * 2**0.5:.3f} px in all  "
            f"error/sigma {normalised:.2f}, within one sigma {inside:.2f} (0.68)"
        )


def measure(net: StackNet, width_px: float, scenes: int, coded: bool) -> Tally:
    """Everything about one width."""
    tally = Tally()
    for number in range(scenes):
        for crop, centre in centred_crops(FIRST_TEST_SEED + number, width_px, "drone", coded=coded, size_px=CROP_PX):
            found = net.run(np.ascontiguousarray(crop[None]), SCORE)[0]
            off = found.centre_px - centre
            near = np.hypot(off[:, 0], off[:, 1]) < max(OTHER_PX, width_px / 2)
            tally.objects += 1
            tally.false += int((~near).sum())
            if near.any():
                best = int(np.argmax(np.where(near, found.score, -1)))
                tally.errors.append(off[best])
                tally.sigmas.append(float(found.sigma_px[best]))
    return tally


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench.detection_rendered", description=__doc__)
    parser.add_argument("--model", default=str(SHIPPED_MODEL))
    parser.add_argument("--scenes", type=int, default=20)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    net = StackNet(open_model(options.model))
    print(f"{options.model}, drones, {options.scenes} scenes a width, seeds from {FIRST_TEST_SEED}")
    for coded in (False, True):
        print(f"\n{'through ' + CODEC if coded else 'raw'}")
        for width_px in WIDTHS_PX:
            print(f"{width_px:4.0f} px wide: {measure(net, width_px, options.scenes, coded).line()}", flush=True)


if __name__ == "__main__":
    main()
