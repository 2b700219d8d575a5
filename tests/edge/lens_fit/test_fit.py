"""A lens comes back from pictures of a board, with a sigma that is true and bad pictures named."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from edge.app import main
from edge.commands.lens import find_views
from edge.common.errors import ConfigError, LensError
from edge.config import LensConfig, load
from edge.lens import LensModel, ray_to_pixel
from edge.lens_fit.boards import BoardView, Charuco, Chessboard, parse_board
from edge.lens_fit.fit import fit_lens
from tests.places import DATA

SIZE = (1920, 1080)
NOISE_PX = 0.1
RADTAN = LensModel("radtan", (1400.0, 1405.0, 965.0, 535.0), (-0.22, 0.08, 0.0005, -0.0004), SIZE)
FISHEYE = LensModel("fisheye", (620.0, 621.0, 955.0, 545.0), (0.03, -0.01, 0.004, -0.001), SIZE)
RECORDED = DATA / "lens"


def turn(x: float, y: float, z: float) -> np.ndarray:
    return cv2.Rodrigues(np.array([x, y, z]))[0]


def seen(lens: LensModel, count: int, seed: int, noise: float = NOISE_PX) -> list[BoardView]:
    """A 9 x 6 board held into the image, tilted every which way, wholly visible."""
    rng = np.random.default_rng(seed)
    across, down = np.meshgrid(np.arange(9), np.arange(6))
    board = np.stack([across.ravel(), down.ravel(), np.zeros(54)], axis=1) * 30.0
    views: list[BoardView] = []
    while len(views) < count:
        pose = turn(*rng.uniform((-0.6, -0.6, -0.3), (0.6, 0.6, 0.3)))
        reach = 1.1 if lens.model == "fisheye" else 0.5
        middle = np.array([*rng.uniform(-reach, reach, 2) * (1, 0.6), 1.0]) * rng.uniform(250, 700)
        inside = (board - board.mean(axis=0)) @ pose.T + middle
        if inside[:, 2].min() < 50:
            continue
        pixels = ray_to_pixel(lens, inside[:, :2] / inside[:, 2:])
        if np.all((pixels > 10) & (pixels < np.array(SIZE) - 10)):
            views.append(BoardView(f"{len(views):02}.png", board, pixels + rng.normal(0, noise, pixels.shape)))
    return views


@pytest.mark.parametrize("lens", [RADTAN, FISHEYE], ids=["radtan", "fisheye"])
def test_lens_comes_back_within_its_own_sigma(lens: LensModel) -> None:
    fit = fit_lens(seen(lens, 20, seed=2), SIZE, lens.model)
    assert fit.lens.focal_sigma_px is not None
    off = np.abs(np.subtract(fit.lens.intrinsics[:2], lens.intrinsics[:2]))
    assert np.all(off < 4 * fit.lens.focal_sigma_px)  # five groups make a rough sigma: 4 of it leave 1 in 100
    assert fit.lens.focal_sigma_px < 0.005 * lens.intrinsics[0]
    # Two coordinates, less the parameters that the fit has eaten.
    assert fit.rms_px == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.1)
    assert fit.held_out_rms_px < 1.3 * fit.rms_px
    assert not fit.rejected


@pytest.mark.parametrize("seed", [3, 7])  # of which a fit that the blurred one bends has no ray for a good one's corner
def test_only_the_blurred_picture_is_left_out_and_named(seed: int) -> None:
    views = seen(RADTAN, 15, seed=seed)
    rng = np.random.default_rng(seed + 1)
    views[6] = BoardView(
        "blurred.png", views[6].board_mm, views[6].image_px + rng.normal(0, 3, views[6].image_px.shape)
    )
    fit = fit_lens(views, SIZE, "radtan")
    assert list(fit.rejected) == ["blurred.png"]
    assert "rms" in fit.rejected["blurred.png"]
    assert fit.rms_px < 0.2


def test_too_few_pictures_are_refused() -> None:
    with pytest.raises(LensError, match="found in 4 pictures, 6 are needed"):
        fit_lens(seen(RADTAN, 4, seed=5), SIZE, "radtan")


def test_coverage_shows_what_was_not_seen() -> None:
    views = [view for view in seen(RADTAN, 60, seed=6) if view.image_px[:, 0].max() < SIZE[0] / 2]
    fit = fit_lens(views, SIZE, "radtan")
    assert fit.coverage[:, :4].sum() == 54 * (len(views) - len(fit.rejected))
    assert fit.coverage[:, 4:].sum() == 0


def picture(board: np.ndarray, tilt: tuple[float, float], size: tuple[int, int] = (960, 720)) -> np.ndarray:
    """A photograph of a drawn board by a pinhole of 900 px, tilted by two angles."""
    height, width = board.shape
    matrix = np.array([[900.0, 0, size[0] / 2], [0, 900.0, size[1] / 2], [0, 0, 1]])
    pose = turn(*tilt, 0.05)
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], float) - (width / 2, height / 2)
    inside = np.column_stack([corners, np.zeros(4)]) @ pose.T + (0, 0, 1.45 * width)
    there = inside @ matrix.T
    warp = cv2.getPerspectiveTransform(
        (corners - corners[0]).astype(np.float32), (there[:, :2] / there[:, 2:]).astype(np.float32)
    )
    return cv2.warpPerspective(board, warp, size, flags=cv2.INTER_AREA, borderValue=255)


TILTS = [(0.0, 0.0), (0.5, 0.1), (-0.5, 0.2), (0.1, 0.5), (0.2, -0.5), (-0.35, -0.35), (0.4, 0.4), (-0.2, 0.45)]


def chessboard() -> np.ndarray:
    squares = np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((60, 60))) * 255
    return np.pad(squares, 60, constant_values=255).astype(np.uint8)


@pytest.mark.parametrize("pattern", ["chessboard", "charuco"])
def test_command_writes_a_lens_that_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str], pattern: str) -> None:
    drawn = chessboard() if pattern == "chessboard" else Charuco(9, 6, 60).board.generateImage((720, 540), None, 60)
    for k, tilt in enumerate(TILTS):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(drawn, tilt))
    cv2.imwrite(str(tmp_path / "8.png"), np.full((720, 960), 255, np.uint8))
    cv2.imwrite(str(tmp_path / "9.png"), np.full((480, 640), 255, np.uint8))
    out = tmp_path / "lens.toml"
    assert (
        main(["lens", str(tmp_path), "--board", "9x6", "--pattern", pattern, "--square-mm", "60", "-o", str(out)]) == 0
    )
    lens = load(out, LensConfig)
    assert lens.size_px == (960, 720)
    # Resampled drawings, corners to 0.1 px, eight views: 1 %.
    assert lens.intrinsics[:2] == pytest.approx((900, 900), rel=0.01)
    said = capsys.readouterr().out
    assert "8.png: the board was not found" in said
    assert "9.png: is 640 x 480, the others are 960 x 720" in said
    assert "of pictures held out" in said


def test_board_is_refused_where_it_is_none() -> None:
    for text in ("9", "9xa", "1x5"):
        with pytest.raises(ConfigError, match="--board"):
            parse_board(text, "chessboard", 1.0)


def test_pictures_without_a_board_are_told_from_unreadable_ones() -> None:
    views, size, missed = find_views(Chessboard(9, 6, 1), iter([("a", np.zeros((48, 64), np.uint8)), ("b", None)]))
    assert (views, size) == ([], (64, 48))
    assert missed == {"a": "the board was not found", "b": "cannot be read"}


@pytest.mark.skipif(not RECORDED.is_dir(), reason="the recordings in ../shared/data are not here")
@pytest.mark.parametrize(("name", "focal_px"), [("gopro3", (874.5, 894.1)), ("sonyG", (1462.0, 1462.0))])
def test_recorded_boards_give_the_published_focal_length(
    tmp_path: Path, name: str, focal_px: tuple[float, float]
) -> None:
    out = tmp_path / "lens.toml"
    pictures = sorted(map(str, (RECORDED / name).iterdir()))[::2]  # half of them: a second each
    assert main(["lens", *pictures, "--board", "6x7", "-o", str(out)]) == 0
    assert load(out, LensConfig).intrinsics[:2] == pytest.approx(focal_px, rel=0.01)  # themselves good to 1 %


def drawn(columns: int, rows: int, angle: float) -> np.ndarray:
    """A picture of a chessboard of inner corners, turned a little."""
    squares = np.indices((rows + 1, columns + 1)).sum(axis=0) % 2 * 255
    board = np.kron(squares, np.ones((20, 20))).astype(np.uint8)
    picture = np.full((300, 400), 255, np.uint8)
    top, left = (300 - board.shape[0]) // 2, (400 - board.shape[1]) // 2
    picture[top : top + board.shape[0], left : left + board.shape[1]] = board
    turned = cv2.getRotationMatrix2D((200, 150), angle, 1.0)
    return cv2.GaussianBlur(cv2.warpAffine(picture, turned, (400, 300), borderValue=255), (3, 3), 0)


@pytest.mark.parametrize("size", [(6, 4), (9, 7), (8, 5)])
def test_a_board_of_another_size_is_named_after_three_pictures(size: tuple[int, int]) -> None:
    named = [(f"{k}.png", drawn(*size, angle)) for k, angle in enumerate((-9.0, 0.0, 7.0))]
    looked_at = iter([*named, ("never", None)])
    with pytest.raises(LensError, match=f"--board {size[0]}x{size[1]}"):
        find_views(Chessboard(13, 10, 1), looked_at)
    assert next(looked_at) == ("never", None)
