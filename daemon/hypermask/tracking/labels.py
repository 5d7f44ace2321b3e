"""Which blob is which LED, under any roll and among reflections.

1. The corner LEDs are a rectangle: in the image its two diagonals share their midpoint (nearly;
   perspective). All pairs of pairs of blobs with coinciding midpoints are quadrilaterals.
2. Each quadrilateral, in each of its four cyclic orders, is read as a weak-perspective view of the
   rectangle. That has two solutions, mirror images in depth, and each says where the label LED,
   proud of the rectangle's plane, must be seen: only a blob there keeps the hypothesis.
3. What is left is refined with full perspective, all at once, and judged by its reprojection.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.geometry import Array, Pinhole, Pose
from hypermask.tracking.pose import project_with_jacobian

Index = NDArray[np.int64]
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]  # of a cross product
_CYCLES = np.array([[(i - shift) % 4 for i in range(4)] for shift in range(4)])
_DIAGONAL = np.arange(6)
_MIRROR: Array = np.array([[1.0, 1, -1], [1, 1, -1], [-1, -1, 1]])  # the other solution in depth


class LabelSettings(Settings):
    """What counts as the mask."""

    min_distance_m: float = Field(0.6, gt=0)
    max_distance_m: float = Field(4.2, gt=0)
    max_tilt_deg: float = Field(68.0, gt=0, lt=90)
    max_rms_px: float = Field(0.3, gt=0)
    # Another reading of the picture must fit this many times worse.
    unique_ratio: float = Field(3.0, ge=1)
    max_quadrilaterals: int = Field(250, ge=1)
    max_hypotheses: int = Field(64, ge=1)
    # Four LEDs have little redundancy: only where there is hardly any clutter are they taken for
    # the mask, or where it was seen a moment ago, turned much the same way.
    max_blobs_for_four: int = Field(5, ge=4)
    max_blobs_for_four_near: int = Field(7, ge=4)
    near_m: float = Field(0.45, gt=0)
    near_turn_rad: float = Field(0.8, gt=0)
    max_rms_four_px: float = Field(0.15, gt=0)


@dataclass(frozen=True)
class Labelling:
    """blobs: (5,) index of each LED's blob, -1 where unseen; pose: camera_from_mask; rms_px."""

    blobs: Index
    pose: Pose
    rms_px: float


@dataclass(frozen=True)
class _Hypotheses:
    """blobs: (m, 5); rotation: (m, 3, 3); translation: (m, 3)."""

    blobs: Index
    rotation: Array
    translation: Array


def label_blobs(
    points: Array,
    leds: Array,
    camera: Pinhole,
    settings: LabelSettings,
    prior: Pose | None = None,
) -> Labelling | None:
    """The LEDs (5, 3) among blobs at `points` (n, 2), or None when unseen or ambiguous.

    prior: a recent pose; it only decides between readings that fit equally well, and allows
    four corners without the label.
    """
    if len(points) < 4:
        return None
    quads = _quadrilaterals(points, leds, camera, settings)
    found = _judge(
        _with_label(quads, points, leds, camera, settings),
        points,
        leds,
        camera,
        settings,
        settings.max_rms_px,
    )
    if found:
        return _choose(found, settings, prior)
    return _label_four(points, leds, camera, settings, prior)


def _label_four(
    points: Array, leds: Array, camera: Pinhole, settings: LabelSettings, prior: Pose | None
) -> Labelling | None:
    """Three corners and the label; near a recent pose also the four corners."""
    here = np.arange(len(points))
    most = settings.max_blobs_for_four
    if prior is not None:
        reach = settings.near_m * camera.matrix[0, 0] / max(float(prior.translation[2]), 0.1)
        middle = camera.project(prior.translation)
        here = np.flatnonzero(np.abs(_complex(points - middle)) < reach)
        most = settings.max_blobs_for_four_near
    if not 4 <= len(here) <= most:
        return None
    hypotheses = [_three_and_label(points[here], leds, camera, settings)]
    if prior is not None:
        quads = _quadrilaterals(points[here], leds, camera, settings)
        hypotheses.append(_without_label(quads, points[here], leds, camera))
        hypotheses = [_turned_like(h, prior, settings) for h in hypotheses]
    found: list[Labelling] = []
    for h in hypotheses:
        found += _judge(h, points[here], leds, camera, settings, settings.max_rms_four_px)
    best = _choose(sorted(found, key=lambda x: x.rms_px), settings, prior)
    if best is None:
        return None
    return Labelling(np.where(best.blobs < 0, -1, here[best.blobs]), best.pose, best.rms_px)


def _quadrilaterals(points: Array, leds: Array, camera: Pinhole, settings: LabelSettings) -> Index:
    """(m, 4) clockwise quadrilaterals that may be the rectangle, each in its four cyclic orders."""
    count = len(points)
    z = _complex(points)
    first, second = np.triu_indices(count, 1)
    length = np.abs(z[first] - z[second])
    longest, shortest = _diagonal_limits(leds, camera, settings)
    kept = (length > shortest) & (length < longest)
    first, second, length = first[kept], second[kept], length[kept]
    middle = (z[first] + z[second]) / 2
    tolerance = 2.0 + 0.09 * length
    x, y = middle.real, middle.imag
    gap2 = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
    i, k = np.nonzero(gap2 < (tolerance * tolerance)[:, None])
    ratio = length[i] / length[k]
    pairs = (i < k) & (gap2[i, k] < tolerance[k] ** 2) & (ratio < 2) & (ratio > 0.5)
    i, k = i[pairs], k[pairs]
    a, c, b, d = first[i], second[i], first[k], second[k]
    apart = (a != b) & (a != d) & (c != b) & (c != d)
    a, b, c, d = a[apart], b[apart], c[apart], d[apart]
    turn = ((z[c] - z[a]).conj() * (z[d] - z[b])).imag
    area = np.abs(turn) > 0.25 * np.abs(z[c] - z[a]) * np.abs(z[d] - z[b])
    b, d = np.where(turn > 0, b, d), np.where(turn > 0, d, b)
    quads = np.stack([a, b, c, d], axis=1)[area]
    if len(quads) > settings.max_quadrilaterals:
        miss = (gap2[i, k] / (tolerance[i] * tolerance[k]))[apart][area]
        quads = quads[np.argsort(miss, kind="stable")[: settings.max_quadrilaterals]]
    cyclic: Index = quads[:, _CYCLES].reshape(-1, 4)
    return cyclic


def _complex(points: Array) -> NDArray[np.complex128]:
    """Points (..., 2) as complex numbers: half the work for numpy."""
    z: NDArray[np.complex128] = points[..., 0] + 1j * points[..., 1]
    return z


def _diagonal_limits(leds: Array, camera: Pinhole, settings: LabelSettings) -> tuple[float, float]:
    diagonal = float(np.linalg.norm(leds[0] - leds[2])) * float(camera.matrix[0, 0])
    tilt = np.cos(np.radians(settings.max_tilt_deg))
    return 1.25 * diagonal / settings.min_distance_m, tilt * diagonal / settings.max_distance_m


def _with_label(
    quads: Index, points: Array, leds: Array, camera: Pinhole, settings: LabelSettings
) -> _Hypotheses:
    """Hypotheses whose label LED is there, the best matching first."""
    if not len(quads):
        return _Hypotheses(np.empty((0, 5), np.int64), np.empty((0, 3, 3)), np.empty((0, 3)))
    rotation, translation = weak_perspective(points[quads], leds, camera)
    good = _plausible(rotation, translation, settings)
    blobs, rotation, translation = (
        np.concatenate([quads, quads])[good],
        rotation[good],
        translation[good],
    )
    predicted = project_with_jacobian(rotation, translation, leds, camera)[0]
    # The weak perspective's own error at the corners tells how far its prediction can be trusted.
    place, wanted = _complex(points), _complex(predicted)
    slack = np.abs(wanted[:, :4] - place[blobs]).max(axis=1)
    near = np.abs(wanted[:, 4, None] - place)
    near[np.arange(len(blobs))[:, None], blobs] = np.inf
    size = np.abs(place[blobs[:, 0]] - place[blobs[:, 2]])
    tolerance = 2.0 + 0.05 * size + 0.7 * slack
    row, label = np.nonzero(near < np.minimum(tolerance, 0.15 * size + 2)[:, None])
    order = np.argsort(near[row, label] / tolerance[row], kind="stable")[: settings.max_hypotheses]
    row, label = row[order], label[order]
    return _Hypotheses(
        np.concatenate([blobs[row], label[:, None]], axis=1), rotation[row], translation[row]
    )


def weak_perspective(corners: Array, leds: Array, camera: Pinhole) -> tuple[Array, Array]:
    """Both poses (2 m, ...) whose scaled orthographic view along the line of sight to the
    rectangle's middle is the best parallelogram through `corners` (m, 4, 2).

    The third components of the first two columns of R follow from their being orthogonal and of
    equal length: (c2 + i c1)^2 = |a1|^2 - |a2|^2 - 2 i a1.a2, up to the common sign.
    """
    focal = camera.matrix[[0, 1], [0, 1]]
    rays = (corners - camera.matrix[:2, 2]) / focal
    fit = _parallelogram_fit(leds[:4, :2].tobytes())
    middle = rays.sum(axis=1) * 0.25  # numpy's mean takes three times as long
    to_axis, stretch = _turn_to_axis(middle)
    derivative = (fit @ rays).swapaxes(-1, -2)
    derivative = to_axis[:, :2, :2] @ derivative / stretch[:, None, None]
    a1, a2 = derivative[..., 0], derivative[..., 1]
    square1, square2 = (a1 * a1).sum(1), (a2 * a2).sum(1)
    root = np.sqrt(square1 - square2 - 2j * (a1 * a2).sum(1))
    scale = np.sqrt(square1 + root.imag**2)
    columns = np.empty((len(corners), 3, 3))
    columns[:, :2, 0], columns[:, 2, 0] = a1 / scale[:, None], root.imag / scale
    columns[:, :2, 1], columns[:, 2, 1] = a2 / scale[:, None], root.real / scale
    r1, r2 = columns[:, :, 0], columns[:, :, 1]
    columns[:, :, 2] = r1[:, _NEXT] * r2[:, _AFTER] - r1[:, _AFTER] * r2[:, _NEXT]
    back = to_axis.swapaxes(-1, -2)
    rotation = np.concatenate([back @ columns, back @ (columns * _MIRROR)])
    ray = np.concatenate([middle, np.ones((len(middle), 1))], axis=1)
    centre = ray / (stretch * scale)[:, None]
    offset = leds[:4].mean(axis=0)
    return rotation, np.concatenate([centre, centre]) - rotation @ offset


@lru_cache(maxsize=8)
def _parallelogram_fit(corners: bytes) -> Array:
    """(2, 4): a parallelogram's derivative by x and y from its corners (4, 2); always the same
    for a mask."""
    flat = np.frombuffer(corners).reshape(4, 2)
    flat = flat - flat.mean(axis=0)
    return np.asarray(np.linalg.solve(flat.T @ flat, flat.T), float)


def _turn_to_axis(middle: Array) -> tuple[Array, Array]:
    """Rotations (m, 3, 3) that turn the lines of sight (x, y, 1) on to the axis, and the lines'
    lengths."""
    x, y = middle[:, 0], middle[:, 1]
    length = np.sqrt(1 + x * x + y * y)
    ux, uy, uz = x / length, y / length, 1 / length
    k = 1 / (1 + uz)
    turn = np.empty((len(middle), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 0, 2] = 1 - k * ux * ux, -k * ux * uy, -ux
    turn[:, 1, 0], turn[:, 1, 1], turn[:, 1, 2] = -k * ux * uy, 1 - k * uy * uy, -uy
    turn[:, 2, 0], turn[:, 2, 1], turn[:, 2, 2] = ux, uy, uz
    return turn, length


def _plausible(rotation: Array, translation: Array, settings: LabelSettings) -> NDArray[np.bool_]:
    """In the distance range and facing the camera: the mask's z axis close to the line of sight."""
    distance = np.sqrt((translation * translation).sum(-1))
    facing = -(rotation[..., :, 2] * translation).sum(-1) / np.maximum(distance, 1e-9)
    good: NDArray[np.bool_] = (
        (distance > settings.min_distance_m)
        & (distance < settings.max_distance_m)
        & (facing > np.cos(np.radians(settings.max_tilt_deg)))
    )
    return good


def _judge(
    hypotheses: _Hypotheses,
    points: Array,
    leds: Array,
    camera: Pinhole,
    settings: LabelSettings,
    max_rms: float,
) -> list[Labelling]:
    """Refine all hypotheses; those that fit, the best first, each reading once."""
    blobs = hypotheses.blobs
    if not len(blobs):
        return []
    rotation, translation, rms = refine_all(
        hypotheses.rotation, hypotheses.translation, points[blobs], leds, camera, blobs >= 0
    )
    good = np.nonzero((rms < max_rms) & _plausible(rotation, translation, settings))[0]
    found: list[Labelling] = []
    for k in good[np.argsort(rms[good], kind="stable")].tolist():
        if not any(np.array_equal(blobs[k], other.blobs) for other in found):
            found.append(Labelling(blobs[k], Pose(rotation[k], translation[k]), float(rms[k])))
    return found


def refine_all(
    rotation: Array,
    translation: Array,
    seen: Array,
    leds: Array,
    camera: Pinhole,
    valid: NDArray[np.bool_],
) -> tuple[Array, Array, Array]:
    """Gauss-Newton on m poses at once: points (m, 5, 2), valid (m, 5). Also rms (m,) in px;
    infinite where a pose ran away."""
    weight = np.repeat(valid, 2, axis=1).astype(float)
    lost = np.zeros(len(rotation), bool)
    for _ in range(6):
        projected, jacobian = project_with_jacobian(rotation, translation, leds, camera)
        residual = (seen - projected).reshape(len(seen), -1) * weight
        flat = jacobian.reshape(len(seen), -1, 6) * weight[:, :, None]
        transposed = flat.swapaxes(-1, -2)
        normal = transposed @ flat
        # A grain of damping: a bad hypothesis may be singular, a good one does not notice.
        normal[:, _DIAGONAL, _DIAGONAL] *= 1 + 1e-9
        normal[:, _DIAGONAL, _DIAGONAL] += 1e-6
        step = np.linalg.solve(normal, transposed @ residual[:, :, None])
        residual -= (flat @ step)[:, :, 0]
        step = step[:, :, 0]
        size2 = (step * step).sum(axis=1)
        lost |= ~(size2 < 4)
        step[lost] = 0
        rotation = _small_rotations(step[:, :3]) @ rotation
        translation = translation + step[:, 3:]
        if (size2[~lost] < 1e-4).all():
            break
    rms = np.sqrt((residual * residual).sum(1) / valid.sum(1))
    # Not converged: no credit for what one more step would promise.
    rms[lost | (size2 > 1e-2)] = np.inf
    return rotation, translation, rms


def _small_rotations(w: Array) -> Array:
    """exp of rotation vectors (m, 3)."""
    angle = np.linalg.norm(w, axis=1)
    small = np.maximum(angle, 1e-9)
    s, c = np.sin(small) / small, (1 - np.cos(small)) / (small * small)
    cross = np.zeros((len(w), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    cross -= cross.swapaxes(-1, -2)
    rotation: Array = np.eye(3) + s[:, None, None] * cross + c[:, None, None] * (cross @ cross)
    return rotation


def _choose(
    found: list[Labelling], settings: LabelSettings, prior: Pose | None
) -> Labelling | None:
    """The reading that fits best, if no other fits nearly as well."""
    if not found:
        return None
    best = found[0]
    # Below this a difference of residuals is noise.
    rivals = [x for x in found if x.rms_px < settings.unique_ratio * max(best.rms_px, 0.05)]
    if len(rivals) == 1:
        return best
    if prior is None:
        return None
    away = [_difference(x.pose, prior) for x in rivals]
    order = np.argsort(away)
    nearest, second = float(away[order[0]]), float(away[order[1]])
    return rivals[int(order[0])] if nearest < 0.15 and second > 3 * nearest else None


def _difference(pose: Pose, other: Pose) -> float:
    """One number for how far two poses are apart: metres at the mask's rim (0.15 m)."""
    turn = np.linalg.norm(pose.rotation - other.rotation) / np.sqrt(2)
    return float(np.linalg.norm(pose.translation - other.translation) + 0.15 * turn)


def _three_and_label(
    points: Array, leds: Array, camera: Pinhole, settings: LabelSettings
) -> _Hypotheses:
    """One corner hidden: complete each ordered triple of blobs to a parallelogram, then look for
    the label."""
    triples = np.array(list(permutations(range(len(points)), 3)))
    a, b, c = points[triples[:, 0]], points[triples[:, 1]], points[triples[:, 2]]
    one, two = b - a, c - b
    triples = triples[(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]) > 0]
    extended = np.concatenate(
        [points, points[triples[:, 0]] - points[triples[:, 1]] + points[triples[:, 2]]]
    )
    made = len(points) + np.arange(len(triples))
    quads = np.column_stack([triples, made])
    quads = np.concatenate([np.roll(quads, shift, axis=1) for shift in range(4)])
    with_label = _with_label(quads, extended, leds, camera, settings)
    blobs = np.where(with_label.blobs < len(points), with_label.blobs, -1)
    real = blobs[:, 4] >= 0
    return _Hypotheses(blobs[real], with_label.rotation[real], with_label.translation[real])


def _without_label(quads: Index, points: Array, leds: Array, camera: Pinhole) -> _Hypotheses:
    """Four corners, the label hidden."""
    rotation, translation = weak_perspective(points[quads], leds, camera)
    blobs = np.concatenate([quads, quads])
    hidden = np.full((len(blobs), 1), -1)
    return _Hypotheses(np.concatenate([blobs, hidden], axis=1), rotation, translation)


def _turned_like(h: _Hypotheses, prior: Pose, settings: LabelSettings) -> _Hypotheses:
    cosine = (np.trace(h.rotation @ prior.rotation.T, axis1=1, axis2=2) - 1) / 2
    close = cosine > np.cos(settings.near_turn_rad)
    return _Hypotheses(h.blobs[close], h.rotation[close], h.translation[close])
