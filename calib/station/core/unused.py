"""What the tracker did not use, in words for the operator: frames that came too late, objects too uncertain to be sent;
and what it uses though a camera speaks against it.

The hazard is the silent cap. A camera whose every frame comes after the horizon adds nothing and looks healthy, and an
object beyond what a short base can measure is simply never there.
"""

from calib.tracking.options import TrackerOptions
from calib.tracking.reports import NotUsed
from edge.common.health import Check


def unused(refused: NotUsed, options: TrackerOptions) -> list[Check]:
    """One check for each camera that is late, one for objects that are too uncertain, one for a contested one."""
    checks = [_late(camera, late_s, options) for camera, late_s in sorted(refused.late_s.items())]
    checks += [] if refused.contested is None else [_contested(*refused.contested)]
    return checks if refused.too_uncertain_m is None else [*checks, _uncertain(refused.too_uncertain_m, options)]


def _late(camera: str, late_s: float, options: TrackerOptions) -> Check:
    return Check(
        f"lateness {camera}",
        "warn",
        f"its frames come {late_s:.1f} s after the others' of the same instant and are not used:"
        f" {options.reorder_horizon_s:g} s are waited for",
        "make its link or detector faster, or raise tracking.reorder_horizon_s",
    )


def _uncertain(sigma_m: float, options: TrackerOptions) -> Check:
    return Check(
        "range",
        "warn",
        f"an object is seen and not sent: its position is uncertain by {sigma_m:.0f} m or more, and"
        f" {options.max_sigma_share:.0%} of its range are allowed, {options.max_sigma_m:g} m at most",
        "set cameras farther apart, or raise tracking.max_sigma_share and tracking.max_sigma_m",
    )


def _contested(seen_by: tuple[str, ...], denied_by: tuple[str, ...]) -> Check:
    do_not = "do not" if len(denied_by) > 1 else "does not"
    return Check(
        "witnesses",
        "warn",
        f"{' and '.join(denied_by)} should see an object that {' and '.join(seen_by)} report, and {do_not}",
        "compare their pictures: a mask, a tree, the sun, or a box that reports what is not there",
    )
