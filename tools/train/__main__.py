"""Train a detector for edge-node from labelled clips, a user's own YOLO folder, or both.

    python -m tools.train --clips ../shared/data/ddt --out edge/models/skyfix
    python -m tools.train --yolo my-images --out my-model

Needs the `train` extra (torch, onnx). Writes OUT-fp32.onnx, OUT.onnx (the same with an int8 body) and OUT.pt, the
weights to go on from with `--begin`. About 55 minutes on one CPU core; minutes with a GPU.
"""

import argparse
import fnmatch
import logging
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch

from edge.common.errors import SkyfixError
from tools.train.compose import Composer
from tools.train.export import About, export
from tools.train.footage import Material, read_clip, read_split
from tools.train.loop import Schedule, train
from tools.train.mine import SigmaFit, find_measured, fit_sigma, weigh_backgrounds
from tools.train.net import SkyNet
from tools.train.patches import CLASSES
from tools.train.rendered import render_material
from tools.train.yolo import all_classes, read_folder, read_names

STEPS = 32000  # of 32 samples: 46 minutes on one CPU core; the losses still fall, but slowly
SCENES = 120  # rendered: about 1700 patches and 1400 backgrounds, a fifth of what the clips give
SIGMA_SCENES = 150  # rendered, for the calibration of sigma
STAGES = (0.25, 0.3, 0.45)  # of the steps: a net that knows nothing yet cannot say which backgrounds are hard
FOOLED = 0.25  # weight of a background from which it counts as a hard one in the log


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser("tools.train", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--clips", type=Path, metavar="FOLDER", help="labelled clips: videos/, labels/, split.json")
    parser.add_argument("--hold-out", action="append", default=[], metavar="GLOB", help="training clips to leave out")
    parser.add_argument("--yolo", type=Path, metavar="FOLDER", help="images/, labels/ and classes.txt or data.yaml")
    parser.add_argument("--step", type=int, default=0, help="images between a stack's frames in --yolo; 0: stills")
    parser.add_argument("--scenes", type=int, default=SCENES, help=f"rendered scenes to add (default {SCENES})")
    parser.add_argument("--out", type=Path, required=True, metavar="NAME", help="what the files are called")
    parser.add_argument("--begin", type=Path, metavar="WEIGHTS.pt", help="go on from these weights")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of 32 samples (default {STEPS})")
    parser.add_argument("--minutes", type=float, default=math.inf, help="stop sooner, whatever step it is at by then")
    parser.add_argument("--threads", type=int, default=1, help="of torch on a CPU (default 1; more is often slower)")
    parser.add_argument("--rate", type=float, default=Schedule.rate, help=f"learning rate (default {Schedule.rate:g})")
    parser.add_argument("--seed", type=int, default=20260611)
    parser.add_argument("--origin", default="", help="one sentence for the model's metadata: what it was trained on")
    options = parser.parse_args(arguments)
    if not options.clips and not options.yolo:
        parser.error("nothing to train on: give --clips or --yolo")
    return options


def main(arguments: list[str] | None = None) -> int:
    """Read, train, calibrate, export. 0 done, 1 it could not be done, 2 wrong usage."""
    options = parse(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    cv2.setNumThreads(1)
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    print(f"seed {options.seed}")
    begun = time.monotonic()
    try:
        run(options)
    except SkyfixError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"done in {(time.monotonic() - begun) / 60:.1f} minutes")
    return 0


def run(options: argparse.Namespace) -> None:
    """The whole of a training, in order."""
    log = logging.getLogger("train").info
    classes = all_classes(read_names(options.yolo)) if options.yolo else CLASSES
    material = gather(options)
    counts = (len(material.patches), len(material.backgrounds), len(material.cutouts))
    log("%d patches, %d backgrounds, %d cut-outs", *counts)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    weights = options.out.with_name(options.out.name + ".pt")

    def watch(half_trained: SkyNet, line: str) -> None:
        log(line)
        torch.save(half_trained.state_dict(), weights)

    net = SkyNet(len(classes))
    if options.begin:
        net.load_state_dict(torch.load(options.begin, weights_only=True))
    net = teach(net, material, options, watch)
    found = find_measured(net, Composer(material, options.seed + 1), SIGMA_SCENES)
    sigma = fit_sigma(found)
    before, after = found.normalised(SigmaFit()), found.normalised(sigma)
    log(
        "sigma: normalised error %.2f, calibrated %.2f, over %d objects: %s", before, after, len(found.log_sigma), sigma
    )
    torch.save(net.state_dict(), weights)
    export(
        net,
        sigma,
        options.out,
        About(classes, options.origin or origin(options), options.seed),
        Composer(material, options.seed + 2),
    )


def teach(net: SkyNet, material: Material, options: argparse.Namespace, watch: Callable[[SkyNet, str], None]) -> SkyNet:
    """Train in stages; before each but the first, backgrounds are weighed by how they fool what has been learned."""
    composer = Composer(material, options.seed)
    for number, share in enumerate(STAGES):
        if number and material.backgrounds:
            liking, spots = weigh_backgrounds(net, material.backgrounds)
            told = "%d of the backgrounds fool it, %d hold an object without a label"
            logging.getLogger("train").info(told, (liking > FOOLED).sum(), (liking == 0).sum())
            composer.prefer_backgrounds(liking, spots)
        schedule = Schedule(max(int(options.steps * share), 1), options.minutes * 60 * share, rate=options.rate)
        net = train(net, composer, schedule, watch)
    return net


def gather(options: argparse.Namespace) -> Material:
    """Training material of the folders given. Test clips are not opened."""
    random = np.random.default_rng(options.seed)
    material = Material()
    for clip in clips(options):
        material.add(read_clip(options.clips, clip, random))
    material.add(render_material(options.scenes, random))
    if options.yolo:
        material.add(read_folder(options.yolo, options.step, random))
    return material


def clips(options: argparse.Namespace) -> list[str]:
    """The training clips not held out."""
    names = read_split(options.clips, "train") if options.clips else []
    return [clip for clip in names if not any(fnmatch.fnmatch(clip, pattern) for pattern in options.hold_out)]


def origin(options: argparse.Namespace) -> str:
    """What a model was trained on, in one sentence: for its own note, where the user gives no other."""
    filmed = f"{len(clips(options))} training clips of {options.clips.name}, " if options.clips else ""
    own = f"the pictures of {options.yolo.name}, " if options.yolo else ""
    return f"{filmed}{own}{options.scenes} rendered scenes, drawn silhouettes, skies and foliage"


if __name__ == "__main__":
    sys.exit(main())
