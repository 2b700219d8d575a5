"""From a configuration to the detector it asks for."""

from edge.common.errors import ConfigError
from edge.config import SHIPPED_MODEL, DetectorConfig
from edge.detector.by_size import BySize
from edge.detector.detections import Detector
from edge.detector.formats import AUTO, STACK_FORMAT
from edge.detector.full_frame import FullFrame
from edge.detector.full_scan import FullScan
from edge.detector.mask import Mask, Masked
from edge.detector.providers import placement
from edge.detector.session import open_model
from edge.detector.skyfix import StackNet
from edge.detector.two_stage import TwoStage


def open_detector(config: DetectorConfig, *, background: bool, mask: Mask | None = None) -> Detector:
    """The detector a configuration asks for. background: full scans beside the frames. mask: what it leaves out.

    Raises ModelError, ConfigError.
    """
    detector = _opened(config, background, mask)
    return detector if mask is None else Masked(detector, mask)


def _opened(config: DetectorConfig, background: bool, mask: Mask | None) -> Detector:
    path = config.model or SHIPPED_MODEL
    model = open_model(path, config.threads, config.providers)
    ours = config.format == STACK_FORMAT or (config.format == AUTO and STACK_FORMAT in model.notes)
    if ours and config.mode == "auto":
        return BySize(StackNet(model), config, background=background, mask=mask)
    if ours and config.mode == "two_stage":
        return TwoStage(StackNet(model), config, background=background, mask=mask)
    if ours:
        return FullScan(StackNet(model), config)
    if config.mode == "two_stage":
        raise ConfigError(
            "two_stage needs a model of the skyfix format",
            where=f"detector.model {path}",
            action='leave detector.model out for the one shipped, or set detector.mode to "full_frame"',
        )
    return FullFrame(model, config)


def where_it_runs(config: DetectorConfig) -> str:
    """How many of a model's nodes run where, in words. Raises ModelError, ConfigError."""
    model = open_model(config.model or SHIPPED_MODEL, config.threads, config.providers)
    nodes = placement(model.session)
    if not nodes:
        return "this onnxruntime does not tell where the model runs"
    return ", ".join(f"{count} of {sum(nodes.values())} nodes on {name}" for name, count in nodes.items())
