"""Training material: a cut-out's centre and size against what was drawn, samples whose truth is where it says."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge.common.errors import SourceError
from tools.detection_scores import Boxes
from tools.evaluate_detections import from_zero
from tools.train.backdrops import foliage, sky
from tools.train.camera import code_differences
from tools.train.compose import BOX_VALUES, MAX_BOXES, Composer, Mix
from tools.train.footage import (
    PATCH_PX,
    SMALLEST_PX,
    Loose,
    Material,
    clip_class,
    first_number,
    read_clip,
    read_labels,
    read_split,
    take,
)
from tools.train.paste import Look, Pose, lay
from tools.train.patches import UNKNOWN_CLASS, Box, Cutout, Patch, flies, lift
from tools.train.rendered import FIRST_TEST_SEED, render_material, scene, stacks
from tools.train.silhouettes import MODELS, draw
from tools.train.visible import visible
from tools.train.windows import CROP_PX, crop
from tools.train.yolo import all_classes, read_folder, read_names

SKY_GREY = 150.0


def blob(u: float, v: float, sigma_px: float, size: tuple[int, int] = (64, 64)) -> np.ndarray:
    """A dark round spot on a sloping, noisy sky."""
    y, x = np.mgrid[0 : size[0], 0 : size[1]]
    spot = 90 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * sigma_px**2))
    noise = np.random.default_rng(round(abs(u) * 100)).normal(0, 1, size)
    return np.clip(SKY_GREY + 0.2 * x - 0.1 * y - spot + noise, 0, 255).round().astype(np.uint8)


@pytest.mark.parametrize(("u", "v"), [(30.0, 31.0), (30.5, 31.25), (33.2, 28.7)])
def test_a_cutout_is_centred_to_a_fraction_of_a_pixel(u: float, v: float) -> None:
    cutout = lift(blob(u, v, 2.0), (20, 20, 24, 24))
    assert cutout is not None
    # One grey level of noise in a few dozen pixels of a 90 level spot: a tenth of a pixel is generous.
    assert cutout.frame_px == pytest.approx((u, v), abs=0.1)
    # The spot falls below the sky's scatter at about 2.2 sigma either side.
    assert 5 < cutout.size_px[0] < 12


def test_a_patch_is_scaled_by_the_object_and_not_by_its_loose_label() -> None:
    frame = blob(200.3, 150.6, 1.0, (300, 400))
    label = (180.0, 130.0, 40.0, 40.0)  # six times as wide as what it holds
    material = Material()
    for seed in range(40):
        take(material, [frame] * 3, [Loose((label,) * 3, 0)], np.random.default_rng(seed))
    widths = [patch.boxes[0].width_px for patch in material.patches]
    assert len(widths) == 40
    assert min(widths) > 0.9 * SMALLEST_PX  # a tenth for the rounding of the patch's side
    assert min(widths) < 0.8 * max(widths)


@pytest.mark.parametrize(("contrast", "seen"), [(0, 0), (16, 1)])
def test_an_object_is_visible_by_its_contrast(contrast: int, seen: int) -> None:
    random = np.random.default_rng(8)
    found = []
    for _ in range(300):
        stack = random.normal(SKY_GREY, 2.0, (40, 40, 3))
        stack[19:21, 20:22] -= contrast  # 8 sigma on each of 4 px
        found.append(visible(np.asarray(stack, np.uint8), Box(20.5, 19.5, 2, 2, 0, 1.0)))
    # Noise alone was measured to reach it in 1 of 50; 300 draws scatter by 0.01.
    assert abs(np.mean(found) - seen) < 0.05


def test_one_pixel_on_a_clean_sky_is_visible_and_what_moves_among_leaves() -> None:
    clean = np.full((40, 40, 3), 150, np.uint8)
    clean[20, 20] -= 12
    assert visible(clean, Box(20, 20, 1, 1, 0, 1.0))
    leaves = np.repeat(np.random.default_rng(3).integers(0, 255, (40, 40, 1), np.uint8), 3, axis=2)
    assert not visible(leaves, Box(20, 20, 2, 2, 0, 1.0))
    leaves[20, 20, 0] ^= 128
    assert visible(leaves, Box(20, 20, 2, 2, 0, 1.0))


def test_a_small_object_is_drawn_as_sharp_as_pixels_are() -> None:
    square = Cutout(np.ones((8, 8), np.float32), np.full((8, 8), 50, np.float32), (3.5, 3.5), (8, 8), (0, 0))
    drawn = np.full((20, 20), 150, np.float32)
    lay(drawn, square, Pose(np.array([10.0, 10.0]), (1 / 8, 1 / 8), np.zeros(2)), Look(1, 1, 0))
    # One pixel wide, on a pixel: half of its 100 grey levels at least stay there, whatever it was drawn from.
    assert drawn[10, 10] < 100
    assert (150 - drawn).sum() == pytest.approx(100, rel=0.15)


def test_half_of_the_crops_are_taken_pixel_for_pixel() -> None:
    stack = np.random.default_rng(5).integers(0, 255, (PATCH_PX, PATCH_PX, 3), np.uint8)
    values = {tuple(pixel) for pixel in stack.reshape(-1, 3).tolist()}
    exact = 0
    for seed in range(40):
        image, _ = crop(stack, (), np.random.default_rng(seed))
        exact += all(tuple(pixel) in values for pixel in image.reshape(-1, 3).tolist())
    assert 10 <= exact <= 30  # 20 +- 3 sigma


def test_nothing_is_lifted_where_there_is_nothing_or_no_plain_sky() -> None:
    plain = blob(-500.0, -500.0, 2.0)
    assert lift(plain, (20, 20, 24, 24)) is None
    leaves = np.random.default_rng(1).integers(0, 255, (64, 64)).astype(np.uint8)
    assert lift(leaves, (20, 20, 24, 24)) is None


def test_a_cutout_laid_again_is_where_it_was_put() -> None:
    cutout = lift(blob(30.3, 31.6, 3.0), (14, 14, 34, 34))
    assert cutout is not None
    for scale in (1.0, 0.5, 0.27):
        image = np.full((64, 64), 200, np.float32)
        place = np.array([31.4, 29.8])
        lay(image, cutout, Pose(place, (scale, scale), np.zeros(2)), Look(1.0, 1.0, 0.0))
        weight = np.clip(200 - image - 20, 0, None)
        y, x = np.mgrid[0:64, 0:64]
        centroid = (float((x * weight).sum() / weight.sum()), float((y * weight).sum() / weight.sum()))
        # The centroid of darkness and of silhouette differ a little for an object that is not symmetric.
        assert centroid == pytest.approx(tuple(place), abs=0.15)


def test_drawn_objects_are_centred_on_their_area() -> None:
    random = np.random.default_rng(3)
    for label in MODELS:
        for view in draw(label, random):
            mass = np.minimum(view.matte * 2, 1)
            u = float((mass.sum(axis=0) * np.arange(mass.shape[1])).sum() / mass.sum())
            assert view.centre_px[0] == pytest.approx(u, abs=0.01)
            assert 1 <= view.size_px[0] <= mass.shape[1]


def test_the_same_seed_draws_the_same_samples() -> None:
    material = Material(backgrounds=[np.full((160, 160, 3), 90, np.uint8)])
    first, again, other = (Composer(material, seed).batch(6) for seed in (5, 5, 6))
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])


def test_a_crop_takes_its_boxes_along() -> None:
    y, x = np.mgrid[0:160, 0:160]
    spot = np.clip(200 - 150 * np.exp(-((x - 90.25) ** 2 + (y - 70.75) ** 2) / 8), 0, 255).astype(np.uint8)
    stack = np.stack([spot] * 3, axis=2)
    for seed in range(20):
        image, boxes = crop(stack, (Box(90.25, 70.75, 6, 6, 0, 1.0),), np.random.default_rng(seed))
        weight = np.clip(190 - image[:, :, 0], 0, None)
        rows, cols = np.mgrid[0:CROP_PX, 0:CROP_PX]
        inside = 10 < boxes[0].x_px < CROP_PX - 10 and 10 < boxes[0].y_px < CROP_PX - 10
        if inside:
            assert boxes[0].x_px == pytest.approx(float((cols * weight).sum() / weight.sum()), abs=0.05)
            assert boxes[0].y_px == pytest.approx(float((rows * weight).sum() / weight.sum()), abs=0.05)


def test_empty_samples_are_empty_and_others_are_not() -> None:
    material = Material(backgrounds=[np.full((160, 160, 3), 90, np.uint8)])
    nothing = Composer(material, 1, Mix(empty=1.0)).batch(20)[1]
    something = Composer(material, 1, Mix(empty=0.0)).batch(20)[1]
    assert not nothing.any()
    assert something[:, 0, 7].all()
    assert something.shape == (20, MAX_BOXES, BOX_VALUES)
    assert (something[..., 4] >= UNKNOWN_CLASS).all()


def test_backgrounds_that_fool_the_net_come_more_often() -> None:
    material = Material(backgrounds=[np.full((160, 160, 3), grey, np.uint8) for grey in (0, 255)])
    composer = Composer(material, 1, Mix(patch=0.0, background=1.0, empty=1.0))
    composer.prefer_backgrounds(np.array([0.0, 1.0], np.float32))
    assert composer.batch(30)[0].mean(axis=(1, 2, 3)).min() > 128


def test_backgrounds_are_cut_out_about_the_place_that_fools_the_net() -> None:
    background = np.full((160, 160, 3), 100, np.uint8)
    background[18:23, 138:143] = 250
    composer = Composer(Material(backgrounds=[background]), 1, Mix(patch=0.0, background=1.0, empty=1.0, insects=0.0))
    composer.prefer_backgrounds(np.ones(1, np.float32), np.array([[140.0, 20.0]], np.float32))
    brightest = composer.batch(40)[0].max(axis=(1, 2, 3))
    composer.prefer_backgrounds(np.ones(1, np.float32))
    anywhere = composer.batch(40)[0].max(axis=(1, 2, 3))
    # The spot lies in a corner: by chance a crop holds it one time in six.
    assert (brightest > 150).sum() > 2 * (anywhere > 150).sum()


def test_insects_get_no_box() -> None:
    material = Material(backgrounds=[np.full((160, 160, 3), 90, np.uint8)])
    still = Mix(patch=0.0, background=1.0, empty=1.0, insects=0.0)
    assert not Composer(material, 1, Mix(patch=0.0, background=1.0, empty=1.0, insects=1.0)).batch(20)[1].any()
    swarm, none = (
        np.ptp(Composer(material, 1, mix).sample()[0]) for mix in (Mix(0.0, 1.0, empty=1.0, insects=1.0), still)
    )
    assert swarm > none


def test_a_stack_coded_as_video_stays_near_what_it_was() -> None:
    image = np.full((80, 80, 3), 120, np.float32)
    image[40:48, 40:48, 0] = 30
    stack = np.clip(image, 0, 255).astype(np.uint8)
    code_differences(stack, 60)
    assert np.abs(stack.astype(float) - image).mean() < 2
    assert np.abs(stack[40:48, 40:48, 0].mean() - 30) < 10
    assert stack[:, :, 2].std() < 2


@pytest.mark.parametrize("moves", [True, False])
def test_a_flyer_nobody_labelled_is_no_background(moves: bool) -> None:
    old, new = blob(10.0 if moves else 31.0, 31.0, 2.0), blob(31.0, 31.0, 2.0)
    stack = np.stack([new, new, old], axis=2)
    assert flies(stack, (31.0, 31.0), 8.0) == moves


@pytest.mark.parametrize("backdrop", [sky, foliage])
def test_drawn_backgrounds_move_a_little_and_stay_grey(backdrop: object) -> None:
    images = [backdrop(CROP_PX, np.random.default_rng(seed)) for seed in range(8)]  # type: ignore[operator]
    assert all(image.shape == (CROP_PX, CROP_PX, 3) and np.isfinite(image).all() for image in images)
    # A cloudless sky stands still; most are not.
    assert sum(np.abs(image[:, :, 0] - image[:, :, 2]).max() > 0 for image in images) >= 4


def test_rendered_patches_hold_their_object() -> None:
    random = np.random.default_rng(11)
    material = render_material(2, random)
    assert material.patches
    assert material.backgrounds
    for patch in material.patches:
        for box in patch.boxes:
            assert box.exact == 1
            assert 0 <= box.x_px < patch.stack.shape[1]
            assert 0 <= box.y_px < patch.stack.shape[0]


def test_a_scene_is_its_seed() -> None:
    first, again = (stacks(scene(FIRST_TEST_SEED, 8.0, "drone"))[0] for _ in range(2))
    assert np.array_equal(first[0], again[0])
    assert first[1] == again[1]


def write_clip(folder: Path, clip: str, frames: int = 20, first: int = 0) -> None:
    """A dark spot that crosses a plain sky, with loose labels numbered from `first`, as a lossless video."""
    for sub in ("videos", "labels"):
        (folder / sub).mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(folder / f"videos/{clip}.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (320, 256))
    with (folder / f"labels/{clip}.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["frame", "x_px", "y_px", "width_px", "height_px"])
        for k in range(frames):
            u, v = 100 + 3.0 * k, 120 + 0.5 * k
            writer.write(cv2.cvtColor(blob(u, v, 3.0, (256, 320)), cv2.COLOR_GRAY2BGR))
            rows.writerow([k + first, u - 15, v - 14, 30, 28])
    writer.release()


def test_a_clip_gives_patches_backgrounds_and_cutouts(tmp_path: Path) -> None:
    write_clip(tmp_path, "V_BIRD_001")
    (tmp_path / "split.json").write_text(json.dumps({"train": ["V_BIRD_001"], "test": []}))
    assert read_split(tmp_path, "train") == ["V_BIRD_001"]
    material = read_clip(tmp_path, "V_BIRD_001", np.random.default_rng(1))
    assert len(material.patches) >= 3
    assert material.backgrounds
    assert all(label == clip_class("V_BIRD_001") == 1 for _, label in material.cutouts)
    for (newest, middle, oldest), _ in material.cutouts:
        if newest.frame_px[0] > 125:  # frame 9 or later: three different frames 100 ms apart
            steps = np.diff([oldest.frame_px[0], middle.frame_px[0], newest.frame_px[0]])
            assert steps == pytest.approx([9.0, 9.0], abs=0.5)
    for patch in material.patches:
        box = patch.boxes[0]
        window = patch.stack[:, :, 0].astype(float)
        assert window[round(box.y_px), round(box.x_px)] < np.median(window) - 20


@pytest.mark.parametrize(
    ("labelled", "first"), [((), 0), ((0, 5, 9), 0), ((1, 2, 9), 1), ((4, 10), 1), ((4, 9), 0), ((1, 10), 1)]
)
def test_labels_numbered_from_one_are_told(labelled: tuple[int, ...], first: int) -> None:
    assert first_number(labelled, 10) == first


def test_labels_numbered_from_one_are_counted_from_zero() -> None:
    boxes = Boxes(np.array([1, 2, 10]), np.arange(12.0).reshape(3, 4), np.ones(3))
    assert from_zero(boxes, 10).frame.tolist() == [0, 1, 9]
    assert from_zero(boxes, 20).frame.tolist() == [0, 1, 9]
    assert from_zero(Boxes(boxes.frame - 1, boxes.box_px, boxes.score), 10).frame.tolist() == [0, 1, 9]


def test_a_clip_is_the_same_however_its_labels_are_numbered(tmp_path: Path) -> None:
    found = []
    for first in (0, 1):
        write_clip(tmp_path / str(first), "V_BIRD_001", first=first)
        found.append(read_clip(tmp_path / str(first), "V_BIRD_001", np.random.default_rng(1)))
    assert [patch.boxes for patch in found[0].patches] == [patch.boxes for patch in found[1].patches]
    assert found[0].patches


def test_a_folder_without_a_split_is_named(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="split") as caught:
        read_split(tmp_path, "train")
    assert str(tmp_path) in str(caught.value)


def test_labels_are_read_by_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("frame,x_px,y_px,width_px,height_px\n7,1,2,3,4\n")
    assert read_labels(path) == {7: (1, 2, 3, 4)}


def write_yolo(folder: Path, names: str) -> None:
    for sub in ("images", "labels"):
        (folder / sub).mkdir(parents=True)
    for k in range(7):
        u, v = 60 + 4.0 * k, 90.0
        cv2.imwrite(str(folder / f"images/{k:03d}.png"), blob(u, v, 3.0, (200, 240)))
        box = ((u + 0.5) / 240, (v + 0.5) / 200, 26 / 240, 24 / 200)
        (folder / f"labels/{k:03d}.txt").write_text("0 " + " ".join(f"{x:.6f}" for x in box) + "\n")
    (folder / "classes.txt").write_text(names)


def test_a_users_own_folder_becomes_material(tmp_path: Path) -> None:
    write_yolo(tmp_path, "quadcopter\nballoon\n")
    assert read_names(tmp_path) == ["drone", "balloon"]
    assert all_classes(["drone", "balloon"]) == ("drone", "bird", "aeroplane", "helicopter", "balloon")
    material = read_folder(tmp_path, 2, np.random.default_rng(1))
    assert len(material.patches) == 7
    assert {label for _, label in material.cutouts} == {0}
    moving = [stack for patch in material.patches if (stack := patch.stack) is not None]
    assert any(np.abs(s[:, :, 0].astype(int) - s[:, :, 2]).max() > 50 for s in moving)


def test_a_class_without_a_name_is_refused(tmp_path: Path) -> None:
    write_yolo(tmp_path, "drone\n")
    (tmp_path / "labels/000.txt").write_text("3 0.5 0.5 0.1 0.1\n")
    with pytest.raises(SourceError, match="class 3 has no name"):
        read_folder(tmp_path, 0, np.random.default_rng(1))


@pytest.mark.parametrize(
    "text", ["names: ['drone', 'bird']\n", "train: a\nnames:\n  0: drone\n  1: bird\n", "names:\n  - drone\n  - bird\n"]
)
def test_both_forms_of_data_yaml_are_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "data.yaml").write_text(text)
    assert read_names(tmp_path) == ["drone", "bird"]


@pytest.mark.parametrize(
    ("text", "what"),
    [("names: [drone", "is not YAML"), ("names:\n", "no class names"), ("- drone\n", "no class names")],
)
def test_a_data_yaml_without_names_is_refused(tmp_path: Path, text: str, what: str) -> None:
    (tmp_path / "data.yaml").write_text(text)
    with pytest.raises(SourceError, match=what):
        read_names(tmp_path)


def test_material_adds_up() -> None:
    one = Material([Patch(np.zeros((8, 8, 3), np.uint8), ())], [], [])
    cutout = Cutout(np.ones((1, 1), np.float32), np.ones((1, 1), np.float32), (0, 0), (1, 1), (0, 0))
    one.add(Material([], [np.zeros((8, 8, 3), np.uint8)], [((cutout,) * 3, 0)]))
    assert (len(one.patches), len(one.backgrounds), len(one.cutouts)) == (1, 1, 1)
