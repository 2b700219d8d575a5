"""A scene as the guard's slices of evidence, without the guard."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from calib.guarding.diagnosis import ExpectedErrors
from calib.guarding.evidence import FAULT_SIZE, evidence
from calib.guarding.looks import CameraLook, Expectations, attitudes_rad, look
from calib.guarding.memory import EvidenceMemory, Slice
from calib.guarding.monitor import DISCIPLINED_SIGMA_S
from calib.guarding.objects import Grouping, SeenObject
from calib.guarding.raytracks import RayTracks
from calib.guarding.wander import UNDISCIPLINED_SIGMA_S
from calib.network import POSE_SIZE
from calib.observations import Frame
from calib.sighting import CameraView
from tools.doubles.flight import Scene

SLICE_NS = 500_000_000
BOX_SHARE = 0.05


def looks_of(scene: Scene, tracks: RayTracks, end_ns: int) -> list[CameraLook]:
    network = scene.network
    t_s = network.since_mid_s(end_ns) - 0.1 * (np.arange(5)[::-1] + 0.5)
    clocks = dict.fromkeys(network.ids, DISCIPLINED_SIGMA_S)
    expected = Expectations(network.rms_px, BOX_SHARE, attitudes_rad(network), clocks)
    return [
        look(CameraView.of(camera), tracks.of(camera, network, end_ns - 2 * SLICE_NS), t_s, expected)
        for camera in network.cameras
    ]


def objects_of(looks: list[CameraLook]) -> list[SeenObject]:
    grouping = Grouping(looks, list(combinations(range(len(looks)), 2)))
    for _ in grouping.steps():
        pass
    return grouping.objects()


def slices_of(scene: Scene, stream: Iterator[tuple[int, Frame]]) -> list[Slice]:
    tracks, memory, due_ns = RayTracks(), EvidenceMemory(10**12), 0
    for _, frame in stream:
        tracks.add(frame)
        due_ns = due_ns or frame.t_unix_ns + 3 * SLICE_NS
        if min(tracks.newest_ns.values()) >= due_ns:
            looks = looks_of(scene, tracks, due_ns)
            memory.add(due_ns, [evidence(looks, seen) for seen in objects_of(looks)])
            due_ns += SLICE_NS
    return memory.since(0)


def expected_of(scene: Scene, bound_s: float | None) -> ExpectedErrors:
    """What an honest scene may be off by. bound_s: of all clocks."""
    count = len(scene.network.cameras)
    covariance = np.zeros((count * FAULT_SIZE, count * FAULT_SIZE))
    of_pose = np.concatenate([k * FAULT_SIZE + np.arange(POSE_SIZE) for k in range(count)])
    covariance[np.ix_(of_pose, of_pose)] = scene.network.covariance
    of_clock = np.arange(count) * FAULT_SIZE + POSE_SIZE
    covariance[of_clock, of_clock] = (UNDISCIPLINED_SIGMA_S if bound_s is None else DISCIPLINED_SIGMA_S) ** 2
    bound = np.full(count, np.inf if bound_s is None else bound_s)
    return ExpectedErrors(np.zeros(len(covariance)), np.linalg.inv(covariance), np.full(count, 1300.0), bound)
