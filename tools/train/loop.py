"""The training loop: batches from the composer, AdamW, one cosine, an average of the weights.

Samples are made by a thread beside the optimiser: OpenCV and torch both let go of the interpreter lock. One torch
thread in bfloat16 is the fastest on a shared CPU; spinning OpenMP threads cost twenty times the speed there.
"""

import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import torch
from torch.optim.swa_utils import AveragedModel

from tools.train.compose import Composer
from tools.train.loss import losses
from tools.train.net import SkyNet, cells
from tools.train.patches import Floats, Grey

WARM_UP_SHARE: Final = 0.03  # of the steps
AVERAGE_DECAY: Final = 0.998  # of the weight average: about the last 500 steps
LEAST_RATE: Final = 0.003  # of the full rate, at the very beginning and the very end
QUEUE_BATCHES: Final = 8
REPORT_EVERY: Final = 200  # steps


@dataclass(frozen=True)
class Schedule:
    """How long and how fast. `seconds`, if given, ends it earlier, the rate brought down in time; not reproducible."""

    steps: int
    seconds: float = math.inf
    batch: int = 32
    rate: float = 3e-3
    weight_decay: float = 1e-3

    def progress(self, step: int, elapsed_s: float) -> float:
        """How much of it is behind us, 0..1."""
        return max(step / self.steps, elapsed_s / self.seconds)

    def rate_at(self, progress: float) -> float:
        """The learning rate: a short rise, then half a cosine down to nothing."""
        rise = min(progress / WARM_UP_SHARE, 1.0)
        return self.rate * rise * (0.5 + 0.5 * math.cos(math.pi * min(progress, 1.0))) + self.rate * LEAST_RATE


def device() -> torch.device:
    """The GPU if there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def train(net: SkyNet, composer: Composer, schedule: Schedule, watch: Callable[[SkyNet, str], None]) -> SkyNet:
    """Train `net` for a schedule and return the average of its weights; `watch` sees that and a line now and then."""
    place = device()
    net = net.to(place, memory_format=torch.channels_last).train()
    average = AveragedModel(net, avg_fn=_blend, use_buffers=True)
    optimiser = torch.optim.AdamW(net.parameters(), lr=schedule.rate, weight_decay=schedule.weight_decay)
    sums, begun = torch.zeros(4), time.monotonic()
    for step, (stacks, boxes) in enumerate(_batches(composer, schedule), start=1):
        progress = schedule.progress(step, time.monotonic() - begun)
        for group in optimiser.param_groups:
            group["lr"] = schedule.rate_at(progress)
        sums += _step(net, optimiser, stacks, boxes, place)
        average.update_parameters(net)
        if step % REPORT_EVERY == 0:
            speed = step * schedule.batch / (time.monotonic() - begun)
            parts = " ".join(
                f"{name} {value:.3f}"
                for name, value in zip(("heat", "centre", "size", "class"), sums / REPORT_EVERY, strict=True)
            )
            watch(average.module, f"step {step}/{schedule.steps}  {parts}  {speed:.0f} samples/s")
            sums.zero_()
        if progress >= 1:
            break
    return average.module  # type: ignore[no-any-return]


def _blend(average: torch.Tensor, new: torch.Tensor, count: torch.Tensor | int) -> torch.Tensor:
    """The running average of a weight; over fewer steps at the beginning, or a short training is mostly its first."""
    return average + (new - average) * max(1 - AVERAGE_DECAY, 10 / (10 + int(count)))


def _step(
    net: SkyNet, optimiser: torch.optim.Optimizer, stacks: Grey, boxes: Floats, place: torch.device
) -> torch.Tensor:
    image = cells(torch.from_numpy(stacks).to(place)).contiguous(memory_format=torch.channels_last)
    with torch.autocast(place.type, dtype=torch.bfloat16):
        raw = net(image)
    found = losses(raw.float(), torch.from_numpy(boxes).to(place))
    optimiser.zero_grad(set_to_none=True)
    found.total().backward()
    torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
    optimiser.step()
    return torch.stack([found.heat, found.centre, found.size, found.label]).detach().cpu()


def _batches(composer: Composer, schedule: Schedule) -> Iterator[tuple[Grey, Floats]]:
    """`schedule.steps` batches, made ahead by one thread that ends with the iteration."""
    ready: queue.Queue[tuple[Grey, Floats]] = queue.Queue(QUEUE_BATCHES)
    stop = threading.Event()

    def make() -> None:
        for _ in range(schedule.steps):
            batch = composer.batch(schedule.batch)
            while not stop.is_set():
                try:
                    ready.put(batch, timeout=0.5)
                    break
                except queue.Full:
                    continue
            if stop.is_set():
                return

    maker = threading.Thread(target=make, name="composer", daemon=True)
    maker.start()
    try:
        for _ in range(schedule.steps):
            yield ready.get()
    finally:
        stop.set()
        maker.join()
