"""The status in Prometheus' text format (version 0.0.4), for /metrics.

The hazard is the dashboard that somebody built on a name: what a metric is called stays, whatever it is made from.
"""

from collections.abc import Iterator
from typing import Final

from prometheus_client.core import Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector

from calib.station.core.calibration import Phase
from calib.station.status.status import StationStatus
from edge.common.health import SEVERITY

CONTENT_TYPE: Final = "text/plain; version=0.0.4"
QUANTILES: Final = ("0.5", "0.99")  # of StationStatus.latency_ms

Sample = tuple[dict[str, str], float]  # labels, value


def metrics(status: StationStatus) -> bytes:
    """Everything of the status that is a number."""
    return generate_latest(_Families(status))


class _Families(Collector):
    """The status, as the library wants to be given it."""

    def __init__(self, status: StationStatus) -> None:
        self._status = status

    def collect(self) -> Iterator[Metric]:
        """One family after the other."""
        status, cameras = self._status, self._status.cameras
        yield _family("up_seconds", "since this start", ({}, status.uptime_s))
        yield _family("starts", "of the station, ever", ({}, status.epoch))
        phases = [({"phase": str(phase)}, float(status.phase == phase)) for phase in Phase]
        yield _family("phase", "of the calibration: 1 for the one in force", *phases)
        yield _family("targets", "on the map", ({}, len(status.targets)))
        yield _family("targets_tentative", "not yet confirmed", ({}, status.tentative))
        if status.rms_px is not None:
            yield _family("calibration_rms_px", "residual of the network in force", ({}, status.rms_px))
        if status.latency_ms is not None:
            times = [({"quantile": q}, ms / 1e3) for q, ms in zip(QUANTILES, status.latency_ms, strict=True)]
            yield _family("latency_seconds", "message received to sent", *times)
        yield _family("camera_online", "sends frames", *(({"camera": c.id}, float(c.online)) for c in cameras))
        yield _family("camera_calibrated", "rays are used", *(({"camera": c.id}, float(c.calibrated)) for c in cameras))
        yield _family("camera_missed_total", "frames lost", *(({"camera": c.id}, float(c.missed)) for c in cameras))
        levels = [({"name": item.name}, float(SEVERITY[item.level])) for item in status.health.items]
        yield _family("health", "0 ok, 1 warn, 2 fail", *levels)
        for name, value in sorted(status.counters.items()):
            yield _family(f"{name}_total", "counted since this start", ({}, value))


def _family(name: str, about: str, *samples: Sample) -> Metric:
    """A counter if its name ends as a counter's does, else a gauge."""
    kind = "counter" if name.endswith("_total") else "gauge"
    metric = Metric(f"skyfix_{name.removesuffix('_total')}", about, kind)
    for labels, value in samples:
        metric.add_sample(f"skyfix_{name}", labels, value)
    return metric
