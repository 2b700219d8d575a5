"""Numbers that hold are kept as they are; numbers that do not are named, and motion says what belongs together."""

import numpy as np
import pytest

from calib.solving.linking import link
from calib.solving.numbering import Numbering, judged

HZ = 10.0
COUNT = 600


def flights(seed: int, objects: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t (N,), rays (N, 2), object (N,) of several that wander across a picture, rows of a frame in any order."""
    rng = np.random.default_rng(seed)
    t = np.arange(COUNT) / HZ
    knots = np.arange(0, t[-1] + 5, 5.0)
    paths = []
    for _ in range(objects):
        corners = rng.uniform(-0.6, 0.6, (len(knots), 2))
        smooth = [np.convolve(np.interp(t, knots, corner), np.ones(15) / 15, "same") for corner in corners.T]
        paths.append(np.column_stack(smooth) + rng.normal(0, 7e-4, (COUNT, 2)))
    rays, source = np.stack(paths, axis=1), np.tile(np.arange(objects), (COUNT, 1))
    order = np.argsort(rng.random((COUNT, objects)), axis=1)
    rays = np.take_along_axis(rays, order[:, :, None], axis=1)
    return np.repeat(t, objects), rays.reshape(-1, 2), np.take_along_axis(source, order, axis=1).reshape(-1)


def pure(numbering: Numbering, source: np.ndarray) -> bool:
    """Whether no track is of two objects, and most rows are in tracks of some length."""
    labels = numbering.label
    sizes = np.array([np.sum(labels == label) for label in labels])
    one = all(
        len(np.unique(source[labels == label])) == 1 for label in np.unique(labels) if np.sum(labels == label) > 9
    )
    return bool(one and np.mean(sizes >= 10) > 0.95)


@pytest.mark.parametrize("objects", [1, 2, 4])
def test_numbers_that_hold_are_kept(objects: int) -> None:
    t, rays, source = flights(1, objects)
    got = judged(t, rays, source + 7)
    assert got.fault == ""
    assert np.array_equal(got.label, source + 7)


@pytest.mark.parametrize("seed", range(4))
def test_rows_that_are_missing_or_wrong_are_no_exchange(seed: int) -> None:
    """Half a second lost now and then, one row in fifty anywhere, clutter with numbers of its own."""
    rng = np.random.default_rng(seed)
    t, rays, source = flights(seed, 3)
    lost = np.repeat(np.convolve(rng.random(COUNT) < 0.02, np.ones(5), "full")[:COUNT] > 0, 3)
    rays[rng.random(len(t)) < 0.02] = rng.uniform(-0.8, 0.8, 2)
    number = np.where(rng.random(len(t)) < 0.05, 1000 + np.arange(len(t)), source)
    assert judged(t[~lost], rays[~lost], number[~lost]).fault == ""


@pytest.mark.parametrize("times", [1, 7])
@pytest.mark.parametrize("seed", range(4))
def test_exchanged_numbers(seed: int, times: int) -> None:
    t, rays, source = flights(seed, 2)
    at = np.random.default_rng(seed).uniform(8, 52, times)
    number = np.where(np.searchsorted(np.sort(at), t) % 2 == 1, 1 - source, source)
    got = judged(t, rays, number)
    assert "from one object to another" in got.fault
    assert np.min(np.abs(at - got.at_s)) < 0.2
    assert pure(got, source)


def test_the_place_in_the_frame_as_number() -> None:
    t, rays, source = flights(5, 3)
    order = np.lexsort((rays[:, 0], t))
    number = np.empty(len(t), np.int64)
    number[order] = np.tile(np.arange(3), COUNT)
    got = judged(t, rays, number)
    assert "from one object to another" in got.fault
    assert pure(got, source)


def test_one_number_for_all() -> None:
    t, rays, source = flights(6, 3)
    got = judged(t, rays, np.zeros(len(t), np.int64))
    assert got.fault == "one number stands for several objects in a frame"
    assert pure(got, source)


@pytest.mark.parametrize("every_s", [0.0, 0.9])
def test_a_number_that_lasts_for_moments(every_s: float) -> None:
    t, rays, source = flights(7, 2)
    number = np.arange(len(t)) if every_s == 0 else (t // every_s).astype(np.int64) * 2 + source
    got = judged(t, rays, number)
    assert "lasts for moments only" in got.fault
    assert pure(got, source)


def test_birds_that_come_and_go_are_no_fault() -> None:
    rng = np.random.default_rng(8)
    parts = []
    for k in range(60):
        t = rng.uniform(0, 55) + np.arange(0, rng.uniform(0.3, 4.0), 1 / HZ)
        path = rng.uniform(-0.5, 0.5, 2) + np.outer(t - t[0], rng.uniform(-0.2, 0.2, 2))
        parts.append((np.round(t, 1), path, np.full(len(t), k)))
    t, rays, number = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(t, kind="stable")
    assert judged(t[order], rays[order], number[order]).fault == ""


def test_rows_without_a_ray_belong_to_nothing() -> None:
    t, rays, _ = flights(9, 2)
    rays[::7] = np.nan
    assert (judged(t, rays, np.zeros(len(t), np.int64)).label[::7] == -1).all()


def test_where_two_meet_both_tracks_end() -> None:
    t = np.repeat(np.arange(100) / HZ, 2)
    x = np.column_stack([np.linspace(-0.3, 0.3, 100), np.linspace(0.3, -0.3, 100)])
    rays = np.column_stack([x.reshape(-1), np.zeros(200)])
    label = link(t, rays)
    assert set(label[:20]).isdisjoint(label[-20:])
    assert len(set(label[:80])) == 2
