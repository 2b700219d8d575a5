"""Which tracks are one object: all that agree, those that pass close by apart, and no stranger."""

from dataclasses import replace

import numpy as np
import pytest

from calib.guarding.looks import CameraLook
from calib.guarding.objects import SeenObject
from calib.guarding.raytracks import RayTracks
from tests.calib.guarding.slices import looks_of, objects_of
from tools.doubles.flight import Scene, Spec, frames, make, perturbed

SPEC = Spec(cameras=4, uavs=6, rate_hz=15.0, duration_s=2.0, noise_px=0.6)


def seen_in(scene: Scene) -> tuple[list[CameraLook], list[SeenObject]]:
    tracks = RayTracks()
    for _, frame in frames(scene):
        tracks.add(frame)
    looks = looks_of(scene, tracks, min(tracks.newest_ns.values()))
    return looks, objects_of(looks)


def sources(scene: Scene, looks: list[CameraLook], seen: SeenObject) -> set[int]:
    """The true objects behind an object's tracks."""
    found = set()
    for (camera, track), agrees in zip(seen.members, seen.agree, strict=True):
        if agrees:
            rows = scene.simulated.rows[f"cam{camera}"]
            found.add(int(np.median(rows.source[rows.track == looks[camera].labels[track]])))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_each_object_is_one_and_all_cameras_agree_about_it(seed: int) -> None:
    scene = make(replace(SPEC, seed=seed, clutter=1.0))
    looks, objects = seen_in(scene)
    assert objects
    for seen in objects:
        assert len(sources(scene, looks, seen)) == 1
    assert sum(all(seen.agree) for seen in objects) >= len(objects) - 1


@pytest.mark.parametrize("victim", range(4))
def test_a_turned_camera_passes_by_whichever_pair_was_asked_first(victim: int) -> None:
    scene = make(replace(SPEC, uavs=1))
    cameras = list(scene.network.cameras)
    cameras[victim] = perturbed(cameras[victim], np.r_[np.radians([0.5, 0.7, 0.2]), 0, 0, 0])
    looks, objects = seen_in(replace(scene, network=replace(scene.network, cameras=tuple(cameras))))
    assert len(objects) == 1
    apart = {camera: agrees for (camera, _), agrees in zip(objects[0].members, objects[0].agree, strict=True)}
    assert apart == {camera: camera != victim for camera in range(4)}
    assert sources(scene, looks, objects[0]) == {1}


def test_a_camera_that_agrees_about_one_object_is_not_held_to_have_missed_another() -> None:
    """Its track of a second object is missing: the nearest of the others is another object, not a fault."""
    scene = make(SPEC)
    tracks = RayTracks()
    for _, frame in frames(scene):
        if frame.camera == "cam1":
            kept = frame.label != frame.label[0] if len(frame.label) else np.zeros(0, bool)
            frame = replace(  # noqa: PLW2901
                frame,
                pixels=frame.pixels[kept],
                label=frame.label[kept],
                sigma_px=frame.sigma_px[kept],
                width_px=None if frame.width_px is None else frame.width_px[kept],
            )
        tracks.add(frame)
    looks = looks_of(scene, tracks, min(tracks.newest_ns.values()))
    for seen in objects_of(looks):
        assert all(seen.agree)
