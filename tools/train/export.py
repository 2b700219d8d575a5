"""A trained net as the ONNX file a camera box runs: peaks picked and decoded in the graph, everything said in metadata.

The file is the contract ("skyfix" format): input `(B, H, W, 3)` uint8; outputs boxes `(B, K, 4)` centre and size in
input pixels, scores `(B, K)`, classes `(B, K, n)`, sigma `(B, K)` in px. The box reads the stack's time offsets from
the metadata, so a model of other offsets needs no other program.
"""

import json
from pathlib import Path
from typing import Any, Final

import onnx
import torch
from torch import Tensor, nn
from torch.nn import functional

from tools.train.loss import NOMINAL_LOG_SIZE, centres
from tools.train.net import OUTPUTS_BEFORE_CLASSES, STRIDE, SkyNet
from tools.train.patches import CLASSES, STACK_OFFSETS_S

FORMAT: Final = "skyfix"
FORMAT_VERSION: Final = 1
DETECTIONS: Final = 64  # per image: 16 times what a sky holds, a sixteenth of a 64 px crop's cells is still 16
OPSET: Final = 17


class Decoder(nn.Module):
    """SkyNet with its input cast, its peaks picked and its outputs in pixels."""

    def __init__(self, net: SkyNet, sigma_scale: float) -> None:
        super().__init__()
        self.net = net
        self.log_sigma_scale = float(torch.tensor(sigma_scale).log())

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        raw = self.net(image.permute(0, 3, 1, 2).float())
        heat = torch.sigmoid(raw[:, :1])
        peaks = heat * (heat >= functional.max_pool2d(heat, 3, 1, 1))
        scores, index = peaks.flatten(1).topk(DETECTIONS, dim=1)
        centre, log_sigma = centres(raw)
        size = torch.exp((raw[:, 3:5] + NOMINAL_LOG_SIZE).clamp(max=6))
        boxes = _at(torch.cat([centre, size], dim=1), index)
        classes = _at(raw[:, OUTPUTS_BEFORE_CLASSES:], index).softmax(dim=2)
        sigma = torch.exp(_at(log_sigma, index)[..., 0] + self.log_sigma_scale)
        return boxes, scores, classes, sigma


def _at(maps: Tensor, index: Tensor) -> Tensor:
    """`(B, K, C)` values of maps `(B, C, h, w)` at flat cell numbers `(B, K)`."""
    found = maps.flatten(2).gather(2, index[:, None].expand(-1, maps.shape[1], -1))
    return found.transpose(1, 2)


def export(net: SkyNet, path: Path, *, sigma_scale: float, seed: int, origin: str, classes: tuple[str, ...]) -> None:
    """Write `net` to `path` in the skyfix format."""
    decoder = Decoder(net.cpu().float().eval(), sigma_scale).eval()
    example = torch.zeros(2, 64, 64, 3, dtype=torch.uint8)
    dynamic = {"image": {0: "batch", 1: "height", 2: "width"}}
    names = ["boxes", "scores", "classes", "sigma"]
    torch.onnx.export(
        decoder,
        (example,),
        str(path),
        input_names=["image"],
        output_names=names,
        dynamic_axes=dynamic | {name: {0: "batch"} for name in names},
        opset_version=OPSET,
        dynamo=False,
    )
    describe(path, seed=seed, origin=origin, classes=classes)


def describe(path: Path, *, seed: int, origin: str, classes: tuple[str, ...] = CLASSES) -> None:
    """Write the `skyfix` metadata key of a model file."""
    about: dict[str, Any] = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "classes": list(classes),
        "stack_offsets_s": list(STACK_OFFSETS_S),
        "stride": STRIDE,
        "size_multiple": 16,
        "origin": origin,
        "licence": "Apache-2.0",
        "seed": seed,
    }
    model = onnx.load(str(path))
    onnx.helper.set_model_props(model, {FORMAT: json.dumps(about)})
    onnx.save(model, str(path))
