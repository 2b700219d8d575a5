"""The network file: every number back to the last bit, and a fingerprint that notices the last bit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import CalibrationError
from calib.geometry.rotation import rotation
from calib.network import Camera, Network, from_toml, to_toml
from edge.lens import LensModel

numbers = st.floats(-1e6, 1e6, allow_subnormal=False)


def network(seed: int = 0, offset_s: float = 0.1) -> Network:
    rng = np.random.default_rng(seed)
    cameras = tuple(
        Camera(
            f"cam{k}",
            LensModel(
                "radtan", (1000 + rng.normal(), 1001.0, 960.0, 540.0), tuple(rng.normal(0, 0.1, 5)), (1920, 1080)
            ),
            rotation(rng.normal(size=3)),
            rng.normal(0, 100, 3),
            offset_s,
            rng.normal(0, 1e-4),
            0.0123,
            None if k == 0 else rng.uniform(0.1, 3),
            rng.uniform(0, 3),
        )
        for k in range(3)
    )
    A = rng.normal(size=(18, 18))
    return Network("meadow", (47.4, 8.5, 580.123456789), 1_780_000_000_123_456_789, cameras, A @ A.T, 0.321)


@given(seed=st.integers(0, 10**6), offset_s=numbers)
def test_there_and_back_to_the_last_bit(seed: int, offset_s: float) -> None:
    before = network(seed, offset_s)
    after = from_toml(to_toml(before))
    assert to_toml(after) == to_toml(before)
    assert after.fingerprint == before.fingerprint
    assert after.covariance.tobytes() == before.covariance.tobytes()
    assert after.t_mid_unix_ns == before.t_mid_unix_ns
    for one, two in zip(after.cameras, before.cameras, strict=True):
        assert one.R_cam_enu.tobytes() == two.R_cam_enu.tobytes()
        assert one.centre_enu.tobytes() == two.centre_enu.tobytes()
        assert (one.lens.intrinsics, one.lens.distortion) == (two.lens.intrinsics, two.lens.distortion)
        assert (one.clock_offset_s, one.clock_rate, one.readout_s) == (
            two.clock_offset_s,
            two.clock_rate,
            two.readout_s,
        )
        assert (one.sigma_px, one.correlated_s) == (two.sigma_px, two.correlated_s)


def test_on_whose_word_it_rests_is_kept_and_not_assumed() -> None:
    before = replace(network(), rests_on=("b",))
    assert from_toml(to_toml(before)).rests_on == ("b",)
    older = "\n".join(line for line in to_toml(network()).splitlines() if not line.startswith("rests_on"))
    assert from_toml(older).rests_on == tuple(camera.id for camera in network().cameras), "nobody asked then"


def test_the_fingerprint_notices_the_last_bit() -> None:
    before = network()
    nudged = replace(before.cameras[1], centre_enu=np.nextafter(before.cameras[1].centre_enu, np.inf))
    after = replace(before, cameras=(before.cameras[0], nudged, before.cameras[2]))
    assert after.fingerprint != before.fingerprint
    assert len(before.fingerprint) == 12


@pytest.mark.parametrize(
    "text",
    [
        "",
        "not toml [",
        "[network]\nformat = 99",
        to_toml(network()).replace("R_cam_enu", "R"),
        '[network]\nformat = "1"',
    ],
)
def test_what_is_no_network_is_refused_by_name(text: str) -> None:
    with pytest.raises(CalibrationError, match=r"site/network\.toml.*calibrate again"):
        from_toml(text, where="site/network.toml")


def test_a_matrix_that_is_no_rotation_is_refused() -> None:
    with pytest.raises(CalibrationError, match="no rotation"):
        replace(network().cameras[0], R_cam_enu=np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(CalibrationError, match="covariance of shape"):
        replace(network(), covariance=np.eye(6))


@given(u=st.floats(0, 1919), v=st.floats(0, 1079))
def test_a_bearing_projects_back_onto_its_pixel(u: float, v: float) -> None:
    plain = replace(network().cameras[0], lens=replace(network().cameras[0].lens, distortion=(0.0,) * 4))
    pixel = np.array([[u, v]])
    bearing = plain.bearings_enu(pixel)
    assert np.linalg.norm(bearing) == pytest.approx(1.0)
    # A pixel at 1000 px over 50 m: rounding of a 100 m coordinate is 1e-14 m.
    assert plain.project(plain.centre_enu + 50 * bearing) == pytest.approx(pixel, abs=1e-9)
    assert np.isnan(plain.project(plain.centre_enu - 50 * bearing)).all()
