"""A lens model is one class: one more, made here, goes through every reader, writer and solver that there is."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.network import Camera, Network, from_toml, to_toml
from calib.station.archive import sitefile
from edge.app import main
from edge.common.errors import LensError, MessageError
from edge.config import load_box, load_lens
from edge.lens import LENS_KINDS, LensModel, distort, measured_names, pixel_to_ray, ray_to_pixel
from edge.lens.kinds import Bent, Coefficients, Complex, Kind, squared
from edge.messages import Lens, decode, encode
from tests.calib.flights import site
from tests.synthetic.solving import assert_right, solved

SIZE = (1920, 1080)
BEND = -0.15
DIVISION = ("division", (1000.0, 1001.0, 959.5, 539.5), (BEND,), SIZE)


class Division(Kind):
    """Fitzgibbon (2001): a ray is its place divided by 1 + b times the place's squared distance from the axis."""

    name = "division"
    coefficients = (1,)
    refined_name = "b"

    def bend(self, distortion: Coefficients, rays: Complex) -> Bent:
        """The quadratic equation for the place, solved."""
        (b,) = distortion
        r2 = squared(rays)
        root = np.sqrt(1 - 4 * b * r2)
        scale = 2 / (1 + root)
        per = 4 / (root * (1 + root) ** 2)
        slope = b * per  # of scale, by r2
        along = (scale + r2 * slope).astype(np.complex128)
        return Bent(rays * scale, along, rays * rays * slope, rays * r2 * per)


@pytest.fixture(scope="module", autouse=True)
def division() -> Iterator[None]:
    """The one line that a new class needs in LENS_KINDS."""
    LENS_KINDS["division"] = Division()
    yield
    del LENS_KINDS["division"]


@given(u=st.floats(0, SIZE[0] - 1), v=st.floats(0, SIZE[1] - 1))
def test_a_pixel_comes_back_from_its_ray(u: float, v: float) -> None:
    lens = LensModel(*DIVISION)
    ray = pixel_to_ray(lens, np.array([[u, v]]))
    # As for the lens models of the product: the inverse stops at 1e-9 in normalised coordinates.
    assert np.abs(ray_to_pixel(lens, ray) - [u, v]).max() < 2e-6
    place = (np.array([u, v]) - lens.intrinsics[2:]) / lens.intrinsics[:2]
    assert ray[0] == pytest.approx(place / (1 + BEND * place @ place), abs=1e-8)


@given(x=st.floats(-0.9, 0.9), y=st.floats(-0.5, 0.5))
def test_derivatives_are_those_of_finite_differences(x: float, y: float) -> None:
    lens, ray, step = LensModel(*DIVISION), np.array([[x, y]]), 1e-6
    at = distort(lens, ray)
    for axis in range(2):
        shift = np.eye(2)[axis] * step
        slope = (distort(lens, ray + shift).xy - distort(lens, ray - shift).xy)[0] / (2 * step)
        # Central differences are good to step^2 and to 1e-16 / step.
        assert at.by_ray[0, :, axis] == pytest.approx(slope, abs=1e-8)
    more, less = (lens.refined(np.array([0, 0, 0, 0, sign * step])) for sign in (1, -1))
    slope = (distort(more, ray).xy - distort(less, ray).xy)[0] / (2 * step)
    assert at.by_coefficient[0] == pytest.approx(slope, abs=1e-8)


def test_a_site_that_sees_through_it_is_calibrated_with_it() -> None:
    published = {"lens": "division", "distortion": (BEND,), "published_distortion": (BEND + 0.01,)}
    found = solved(site(offsets_s=(0.0,) * 4, each=published))
    assert_right(found)
    report = found.solution.report.cameras[1]
    assert report.lens_after.model == "division"
    # The file's coefficient is a sigma off; the flight pulls it back to within what the solution says it knows.
    assert abs(report.lens_after.refined_coefficient - BEND) < 4 * report.sigma_lens[4] < 0.02


def test_the_wire_takes_it_and_nothing_that_is_in_no_list() -> None:
    lens = LensModel(*DIVISION)
    assert LensModel.of(decode(encode(Lens.of(lens)), Lens, where="here")) == lens
    unknown = encode(Lens.of(lens)).replace(b"division", b"pinhole")
    with pytest.raises(MessageError, match=r"field `model`: not one of division, fisheye, radtan"):
        decode(unknown, Lens, where="here")


def test_files_take_it(tmp_path: Path) -> None:
    numbers = f"intrinsics = [1000, 1001, 959.5, 539.5]\ndistortion = [{BEND}]\nsize_px = [1920, 1080]\n"
    (tmp_path / "lens.toml").write_text(f'model = "division"\n{numbers}')
    box = tmp_path / "edge.toml"
    box.write_text('site = "a"\n[[camera]]\nid = "b"\nsource.path = "v.mp4"\nlens = "lens.toml"\n')
    assert load_lens(load_box(box).camera[0], box) == LensModel(*DIVISION)
    (tmp_path / "site.toml").write_text(
        f'[site]\nname = "a"\norigin = [0, 0, 0]\n[[camera]]\nid = "b"\nlens = "division"\n{numbers}'
    )
    assert sitefile.load(tmp_path / "site.toml")[2][0].lens == LensModel(*DIVISION)


def test_a_network_keeps_it() -> None:
    camera = Camera("b", LensModel(*DIVISION), np.eye(3), np.zeros(3))
    network = Network("a", (0.0, 0.0, 0.0), 0, (camera,), np.eye(6), 0.1)
    assert from_toml(to_toml(network)).cameras[0].lens == camera.lens


def test_what_cannot_be_measured_from_pictures_is_not_offered(capsys: pytest.CaptureFixture[str]) -> None:
    assert measured_names() == ["fisheye", "radtan"]
    with pytest.raises(SystemExit):
        main(["lens", "a.png", "--board", "9x6", "--model", "division", "-o", "x.toml"])
    assert "fisheye" in capsys.readouterr().err
    with pytest.raises(LensError, match="not measured from pictures"):
        LENS_KINDS["division"].fit([], [], SIZE, 1)


def test_schemas_list_the_names() -> None:
    listed = msgspec.json.schema(Lens)["$defs"]["Lens"]["properties"]["model"]["enum"]
    assert listed == sorted(set(LENS_KINDS) - {"division"})  # as they were when the message was declared
