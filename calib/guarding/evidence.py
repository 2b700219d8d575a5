"""What a slice of raw rays says about poses and clocks, the objects' own places taken out: normal equations.

The hazard is a test of each camera against points that another faulty camera helped to make. Here no camera is special:
each object's place at each instant is a free unknown (its three numbers are eliminated by the Schur complement), and
what is left over says by how much all cameras contradict each other, and which change of which camera would mend it.
A box's centre is off by the same for seconds: every camera has, for each object, an offset of its own in the image
beside pose and clock, with a prior, so that a hundred rows of one object are worth little more than one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calib.guarding.looks import INSTANTS_APART_S, CameraLook
from calib.guarding.objects import SeenObject
from calib.network import POSE_SIZE
from edge.common.arrays import Array

FAULT_SIZE: Final = POSE_SIZE + 1  # rotation vector, centre, clock (s, later)
UNKNOWNS: Final = FAULT_SIZE + 2  # and the offset in the image, px
TOUCHES: Final = 2  # of the tangent: witnesses' middle of two rays is not the best point yet
DEVIANT: Final = 4.0  # sigma from its slice's median, beyond which an instant counts less
SMALLEST_SHARE: Final = 1e-9  # of the largest eigenvalue: less is rounding
FREE_POINT_M2: Final = 1e-8  # 1 / m^2: a point may be anywhere, and two rays alone must not make it singular


@dataclass(frozen=True)
class ObjectEvidence:
    """Of one object in one slice, by its C cameras (numbers in the network).

    normal: (C, 9, C, 9), right: (C, 9), of pose, clock and offset; squares: the sum of squares to be explained, of so
    many degrees of freedom. lasting_px, width_px: (C,). agree: (C,). keys: the camera and its own track number of each.
    turned_px2: (C, 3, 3), a rotation vector's square in it is the mean square it moves the pixels by; speed_px_s: (C,).
    spread_px2: mean square by which the slice's medians contradict each other, a degree of freedom, less noise.
    """

    cameras: Array
    keys: tuple[tuple[int, int], ...]
    agree: tuple[bool, ...]
    normal: Array
    right: Array
    squares: float
    freedom: int
    lasting_px: Array
    width_px: Array
    turned_px2: Array
    speed_px_s: Array
    spread_px2: float


def evidence(looks: Sequence[CameraLook], seen: SeenObject) -> ObjectEvidence:
    """Normal equations of one object's slice, linearised where those that agree meet."""
    own = [looks[camera] for camera, _ in seen.members]
    tracks = [track for _, track in seen.members]
    pixels = np.array([one.pixels[track] for one, track in zip(own, tracks, strict=True)])  # (C, S, 2)
    noise = np.array([one.noise_px[track] for one, track in zip(own, tracks, strict=True)])
    agree = np.array(seen.agree)
    points = seen.points
    for touch in range(TOUCHES + 1):
        sightings = [one.view.sight(points) for one in own]
        by_point = np.array([s.by_point for s in sightings])  # (C, S, 2, 3)
        off = pixels - np.array([s.pixels for s in sightings])
        known = np.isfinite(off[..., 0]) & np.array([s.valid for s in sightings])
        off = np.where(known[..., None], off, 0.0)
        weight = known * _weights(off, known, noise)
        if touch < TOUCHES:
            points = points + _step(by_point, off, weight * agree[:, None])
    by_pose = np.array([s.by_pose for s in sightings])
    velocity = _velocity_px_s(np.array([s.pixels for s in sightings]), known)
    left = _without_points(by_point, weight)
    normal, right, squares = _reduced(left, _design(by_pose, velocity), off)
    by_turn = by_pose[..., :3]
    spread = _spread_px2(left, off, weight)
    lasting = np.array([one.lasting_px[track] for one, track in zip(own, tracks, strict=True)])
    width = np.array([one.width_px[track] for one, track in zip(own, tracks, strict=True)])
    keys = tuple((camera, looks[camera].labels[track]) for camera, track in seen.members)
    cameras = np.array([camera for camera, _ in seen.members])
    return ObjectEvidence(
        cameras,
        keys,
        seen.agree,
        normal,
        right,
        squares,
        2 * int(known.sum()) - 3 * int((known.sum(axis=0) > 1).sum()),
        lasting,
        width,
        np.einsum("csik,csil->ckl", by_turn, by_turn) / by_turn.shape[1],
        np.linalg.norm(velocity, axis=1),
        spread,
    )


def _velocity_px_s(seen: Array, known: NDArray[np.bool_]) -> Array:
    """(C, 2) by the points as they should be seen (C, S, 2): a camera's own rows jump when it is knocked."""
    weight = (known.sum(axis=0) > 1).astype(float)
    if weight.sum() < 2:
        return np.zeros((len(seen), 2))
    t_s = INSTANTS_APART_S * np.arange(seen.shape[1])
    t_s -= np.average(t_s, weights=weight)
    velocity: Array = np.einsum("s,csi->ci", weight * t_s, seen) / float(weight @ t_s**2)
    return velocity


def _weights(off: Array, known: Array, noise: Array) -> Array:
    """(C, S) inverse variances; an instant far from its camera's own median counts less (Geman and McClure 1987).

    In the slice in which a camera is knocked, half the instants are still where they were.
    """
    median = np.array([np.median(o[k], axis=0) if k.any() else np.zeros(2) for o, k in zip(off, known, strict=True)])
    apart = np.linalg.norm(off - median[:, None], axis=2) / noise[:, None]
    weights: Array = 1.0 / noise[:, None] ** 2 / (1 + (apart / DEVIANT) ** 2) ** 2
    return weights


def _step(by_point: Array, off: Array, weight: Array) -> Array:
    """(S, 3) by which points move towards those that agree."""
    weighted = by_point * weight[..., None, None]
    normal = np.einsum("csik,csil->skl", weighted, by_point) + FREE_POINT_M2 * np.eye(3)
    right = np.einsum("csik,csi->sk", weighted, off)
    step: Array = np.linalg.solve(normal, right[..., None])[..., 0]
    return step


def _design(by_pose: Array, velocity_px_s: Array) -> Array:
    """(C, S, 2, 9) derivative of each camera's pixels by its own pose, clock and offset."""
    design = np.zeros((*by_pose.shape[:3], UNKNOWNS))
    design[..., :POSE_SIZE] = by_pose
    design[..., POSE_SIZE] = velocity_px_s[:, None]
    design[..., 0, FAULT_SIZE] = design[..., 1, FAULT_SIZE + 1] = 1.0
    return design


def _without_points(by_point: Array, weight: Array) -> Array:
    """(S, 2 C, 2 C) weight of all cameras' pixels at an instant, once the point is eliminated."""
    count, instants = weight.shape
    J = by_point.transpose(1, 0, 2, 3).reshape(instants, 2 * count, 3)
    w = np.repeat(weight.T, 2, axis=1)  # (S, 2 C)
    weighted = J * w[..., None]
    normal = np.matmul(J.transpose(0, 2, 1), weighted) + FREE_POINT_M2 * np.eye(3)
    left: Array = -np.matmul(weighted, np.linalg.solve(normal, weighted.transpose(0, 2, 1)))
    diagonal = np.arange(2 * count)
    left[:, diagonal, diagonal] += w
    return left


def _reduced(left: Array, design: Array, off: Array) -> tuple[Array, Array, float]:
    """Normal matrix (C, 9, C, 9), right side (C, 9) and sum of squares, over the instants."""
    count, instants = off.shape[:2]
    blocks = left.reshape(instants, count, 2, count, 2).transpose(1, 3, 0, 2, 4)  # (C, D, S, 2, 2)
    half = np.matmul(blocks, design[None])  # (C, D, S, 2, 9)
    half = half.transpose(0, 2, 3, 1, 4).reshape(count, instants * 2, count * UNKNOWNS)
    flat = design.reshape(count, instants * 2, UNKNOWNS).transpose(0, 2, 1)
    normal: Array = np.matmul(flat, half).reshape(count, UNKNOWNS, count, UNKNOWNS)
    flat_off = off.transpose(1, 0, 2).reshape(instants, 2 * count, 1)
    pulled = np.matmul(left, flat_off)
    squares = float((pulled * flat_off).sum())
    pulled = pulled.reshape(instants, count, 2).transpose(1, 0, 2).reshape(count, instants * 2, 1)
    right: Array = np.matmul(flat, pulled)[..., 0]
    return normal, right, squares


def _spread_px2(left: Array, off: Array, weight: Array) -> float:
    """By how much the slice's mean rays contradict each other, px^2 a degree of freedom, less noise."""
    count = len(weight)
    mean = (off * weight[..., None]).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-12)[:, None]
    flat = mean.ravel()
    against = float(flat @ left.sum(axis=0) @ flat)
    degrees = max(2 * count - 3, 1)
    a_weight = float(weight.sum(axis=1).mean())
    return max(against / degrees - 1.0, 0.0) / max(a_weight, 1e-12)


def without_camera(found: ObjectEvidence, camera: int) -> ObjectEvidence | None:
    """The same without one camera (its number in the network): whatever it was off by. None if fewer than two are left.

    All of its unknowns are eliminated without a prior (Schur complement), so that its rays tie nothing together.
    """
    kept = np.nonzero(found.cameras != camera)[0]
    if len(kept) == len(found.cameras):
        return found
    if len(kept) < 2:
        return None
    count = len(kept)
    (gone,) = np.nonzero(found.cameras == camera)[0]
    inner, right = found.normal[gone, :, gone, :], found.right[gone]
    coupled = found.normal[kept][:, :, gone, :].reshape(count * UNKNOWNS, UNKNOWNS)
    inverse = np.linalg.pinv(inner, rcond=SMALLEST_SHARE, hermitian=True)
    normal = found.normal[kept][:, :, kept].reshape(count * UNKNOWNS, count * UNKNOWNS)
    return replace(
        found,
        cameras=found.cameras[kept],
        keys=tuple(found.keys[k] for k in kept),
        agree=tuple(found.agree[k] for k in kept),
        normal=(normal - coupled @ inverse @ coupled.T).reshape(count, UNKNOWNS, count, UNKNOWNS),
        right=(found.right[kept].ravel() - coupled @ inverse @ right).reshape(count, UNKNOWNS),
        squares=max(found.squares - float(right @ inverse @ right), 0.0),
        freedom=max(found.freedom - int(np.linalg.matrix_rank(inner, SMALLEST_SHARE * np.abs(inner).max(), True)), 0),
        lasting_px=found.lasting_px[kept],
        width_px=found.width_px[kept],
        turned_px2=found.turned_px2[kept],
        speed_px_s=found.speed_px_s[kept],
    )
