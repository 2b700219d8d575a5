"""Names of metrics stay; numbers are whole; what stands in a label can't break the text."""

from prometheus_client.parser import text_string_to_metric_families

from calib.station.status.metrics import metrics
from edge.messages import Health, HealthItem
from tests.calib.station.page.test_page import T_NS, camera, status

NAMES = {
    "skyfix_up_seconds",
    "skyfix_starts",
    "skyfix_phase",
    "skyfix_targets",
    "skyfix_targets_tentative",
    "skyfix_calibration_rms_px",
    "skyfix_latency_seconds",
    "skyfix_camera_online",
    "skyfix_camera_calibrated",
    "skyfix_camera_missed_total",
    "skyfix_health",
    "skyfix_mavlink_sent_total",
}


def read(text: bytes) -> dict[tuple[str, str], float]:
    """Values by name and first label."""
    families = text_string_to_metric_families(text.decode())
    return {
        (sample.name, next(iter(sample.labels.values()), "")): sample.value
        for family in families
        for sample in family.samples
    }


def test_dashboards_find_every_name_and_every_digit() -> None:
    found = read(metrics(status(counters={"mavlink_sent": 123_456_789.0})))
    assert {name for name, _ in found} == NAMES
    assert found["skyfix_mavlink_sent_total", ""] == 123_456_789.0
    assert [found["skyfix_phase", phase] for phase in ("collecting", "calibrated", "suspect")] == [0, 1, 0]
    assert found["skyfix_latency_seconds", "0.99"] == 0.002


def test_what_is_not_known_is_left_out() -> None:
    found = read(metrics(status(rms_px=None, latency_ms=None)))
    assert {"skyfix_calibration_rms_px", "skyfix_latency_seconds"}.isdisjoint(name for name, _ in found)


def test_a_name_with_quotes_and_lines_stays_one_label() -> None:
    name = 'a "b"\nskyfix_targets 99\\'
    item = HealthItem(name=name, level="fail", since_unix_ns=T_NS, reason="")
    health = Health(t_unix_ns=T_NS, epoch=1, level="fail", items=[item], counters={})
    found = read(metrics(status([camera("cam0", missed=7)], health=health)))
    assert found["skyfix_health", name] == 2
    assert found["skyfix_targets", ""] == 0
    assert found["skyfix_camera_missed_total", "cam0"] == 7
