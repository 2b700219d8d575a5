"""The model shipped does what its format promises, at any size, in floats and in 8 bits."""

import json
from pathlib import Path

import numpy as np
import onnxruntime as ort
import pytest

import edge
from tools.train.patches import Grey
from tools.train.rendered import FIRST_TEST_SEED, scene, stacks

MODELS = Path(edge.__file__).parent / "models"
OUTPUTS = ["boxes", "scores", "classes", "sigma"]
FOUND = 0.25  # the box's threshold


def session(name: str) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    return ort.InferenceSession(str(MODELS / name), options, providers=["CPUExecutionProvider"])


@pytest.fixture(scope="module", params=["skyfix.onnx", "skyfix-fp32.onnx"])
def model(request: pytest.FixtureRequest) -> ort.InferenceSession:
    return session(request.param)


def sky_with_drone(width_px: float, size: tuple[int, int] = (1080, 1920)) -> tuple[Grey, np.ndarray]:
    """A rendered drone set far right and low in a plain frame of the deployed size, and where its centre is."""
    stack, labels = stacks(scene(FIRST_TEST_SEED + 3, width_px, "drone"))[3]
    u, v = labels[0].centre_px
    x, y = int(u) - 48, int(v) - 48
    patch = stack[y : y + 96, x : x + 96]
    image = np.full((*size, 3), int(np.median(patch)), np.uint8)
    top, left = size[0] - 140, size[1] - 150
    image[top : top + 96, left : left + 96] = patch
    return image, np.array([u - x + left, v - y + top])


def run(model: ort.InferenceSession, image: Grey) -> dict[str, np.ndarray]:
    return dict(zip(OUTPUTS, model.run(OUTPUTS, {"image": image}), strict=True))


def test_it_says_what_it_is(model: ort.InferenceSession) -> None:
    note = json.loads(model.get_modelmeta().custom_metadata_map["skyfix"])
    assert note["format"] == "skyfix"
    assert note["classes"] == ["drone", "bird", "aeroplane", "helicopter"]
    assert note["stack_offsets_s"] == [0.0, -0.1, -0.2]
    assert note["licence"] == "Apache-2.0"
    assert note["origin"]
    assert isinstance(note["seed"], int)
    (image,) = model.get_inputs()
    assert (image.type, image.shape[3]) == ("tensor(uint8)", 3)


@pytest.mark.parametrize("shape", [(1, 64, 64), (8, 64, 64), (1, 72, 104), (1, 1080, 1920)])
def test_it_takes_any_size_in_eights(model: ort.InferenceSession, shape: tuple[int, int, int]) -> None:
    random = np.random.default_rng(1)
    found = run(model, random.integers(100, 110, (*shape, 3)).astype(np.uint8))
    count = found["scores"].shape[1]
    assert found["boxes"].shape == (shape[0], count, 4)
    assert found["sigma"].shape == (shape[0], count)
    assert found["classes"].shape == (shape[0], count, 4)
    assert found["classes"].sum(axis=2) == pytest.approx(1, abs=1e-5)
    assert (np.diff(found["scores"], axis=1) <= 0).all()
    assert all(np.isfinite(value).all() for value in found.values())


@pytest.mark.parametrize("width_px", [5.0, 12.0])
def test_it_finds_a_drone_in_the_far_corner_of_a_full_frame(model: ort.InferenceSession, width_px: float) -> None:
    # In 8 bits, coordinates once saturated at the size of the calibration images: 1900 px is far beyond those.
    image, centre = sky_with_drone(width_px)
    found = run(model, image[None])
    near = np.hypot(*(found["boxes"][0, :, :2] - centre).T) < 3
    assert (found["scores"][0] * near).max() > FOUND
    best = int(np.argmax(found["scores"][0] * near))
    # Five sigmas: a different object would be further off, and a sigma of 1 px would be no measurement.
    assert np.abs(found["boxes"][0, best, :2] - centre).max() < 5 * found["sigma"][0, best] + 0.1
    assert found["sigma"][0, best] < 1


def test_a_crop_and_the_whole_frame_agree(model: ort.InferenceSession) -> None:
    image, centre = sky_with_drone(10.0)
    corner = (centre - 32).astype(int) // 8 * 8
    crop = image[corner[1] : corner[1] + 64, corner[0] : corner[0] + 64]
    whole, part = run(model, image[None]), run(model, crop[None])
    near = np.hypot(*(whole["boxes"][0, :, :2] - centre).T) < 3
    best = int(np.argmax(whole["scores"][0] * near))
    # The crop's border is a few dozen pixels off, at the edge of what the net sees: not equal, but close.
    assert part["boxes"][0, 0, :2] + corner == pytest.approx(whole["boxes"][0, best, :2], abs=0.3)


def test_eight_bits_equal_floats() -> None:
    exact, fast = session("skyfix-fp32.onnx"), session("skyfix.onnx")
    errors = []
    for width_px in (4.0, 8.0, 16.0):
        image, centre = sky_with_drone(width_px)
        places = []
        for each in (exact, fast):
            found = run(each, image[None])
            near = np.hypot(*(found["boxes"][0, :, :2] - centre).T) < max(3, width_px / 2)
            best = int(np.argmax(found["scores"][0] * near))
            assert found["scores"][0, best] * near[best] > FOUND
            places.append(found["boxes"][0, best, :2])
        errors.append(places[0] - places[1])
    assert np.abs(errors).max() < 0.25  # a third of the smallest sigma that matters to the base station
