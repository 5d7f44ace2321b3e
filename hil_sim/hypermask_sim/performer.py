"""Where the mask is at any time: a motion clip, or a built-in path.

Motion is relative to the performer's rest place, in the axes of the clips: x to the audience's
right, y up, z towards the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.errors import ConfigError, DataError

Array = NDArray[np.float64]

COLUMNS = ("t_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
_MAX_POSITION_M = 5.0
_MAX_SPEED_M_S = 30.0
_MAX_GAP_S = 1.0
_MAX_NORM_ERROR = 0.02


class Motion(Protocol):
    @property
    def duration_s(self) -> float | None:
        """How long it goes on; None for ever."""
        ...

    def at(self, times_s: Array) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and positions (n, 3) in metres at times (n,) seconds from 0."""
        ...


@dataclass(frozen=True)
class Clip:
    """Samples of a motion clip: times (n,) s from 0, rows (n, 7) of position and quaternion.

    Between samples a cubic Hermite curve with three-point slopes, as a head has no corners in its
    velocity; before the first and after the last sample the mask holds still.
    """

    times: Array
    rows: Array
    slopes: Array

    @property
    def duration_s(self) -> float | None:
        return float(self.times[-1])

    def at(self, times_s: Array) -> tuple[Array, Array]:
        t = np.clip(times_s, self.times[0], self.times[-1])
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        h = self.times[i + 1] - self.times[i]
        u = (t - self.times[i]) / h
        a, b, hu = u[:, None], (1 - u)[:, None], h[:, None]
        row = (
            self.rows[i] * (b * b * (1 + 2 * a))
            + self.rows[i + 1] * (a * a * (3 - 2 * a))
            + (self.slopes[i] * b - self.slopes[i + 1] * a) * (hu * a * b)
        )
        return _rotations(row[:, 3:]), row[:, :3]


def _rotation_terms() -> Array:
    """(16, 9): the products of a quaternion's parts (w, x, y, z) that make a rotation matrix."""
    w, x, y, z = range(4)
    terms = np.zeros((4, 4, 9))
    for entry, parts in enumerate(
        (
            ((w, w, 1), (x, x, 1), (y, y, -1), (z, z, -1)), ((x, y, 2), (w, z, -2)),
            ((x, z, 2), (w, y, 2)), ((x, y, 2), (w, z, 2)),
            ((w, w, 1), (x, x, -1), (y, y, 1), (z, z, -1)), ((y, z, 2), (w, x, -2)),
            ((x, z, 2), (w, y, -2)), ((y, z, 2), (w, x, 2)),
            ((w, w, 1), (x, x, -1), (y, y, -1), (z, z, 1)),
        )
    ):  # fmt: skip
        for first, second, factor in parts:
            terms[first, second, entry] = factor
    return terms.reshape(16, 9)


_TERMS = _rotation_terms()


def _rotations(quaternions: Array) -> Array:
    """(n, 3, 3) rotation matrices of (n, 4) quaternions w, x, y, z of any length."""
    products = quaternions[:, :, None] * quaternions[:, None, :]
    squares = np.einsum("nii->n", products)
    matrices: Array = (products.reshape(-1, 16) @ _TERMS / squares[:, None]).reshape(-1, 3, 3)
    return matrices


def load_clip(path: Path) -> Clip:
    """Read a motion CSV with the columns `COLUMNS`.

    Raises `ConfigError` MOTION-ABSENT and `DataError` MOTION-FORMAT, which names the line.
    """
    try:
        text = path.read_text("utf-8")
    except FileNotFoundError:
        raise ConfigError(
            "MOTION-ABSENT", f"there is no motion file {path}", "Check performer.motion."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise _bad(path, 1, f"cannot be read as text ({error})") from None
    lines = text.splitlines()
    if not lines or tuple(part.strip() for part in lines[0].split(",")) != COLUMNS:
        raise _bad(path, 1, f"the header is not {','.join(COLUMNS)}")
    numbers = [number for number, line in enumerate(lines[1:], 2) if line.strip()]
    rows = np.array([_row(path, number, lines[number - 1]) for number in numbers])
    if len(rows) < 2:
        raise _bad(path, len(lines), "a clip needs at least two samples")
    _check_steps(path, rows, numbers)
    _check_end(path, text, lines)
    return _clip(rows)


def _check_end(path: Path, text: str, lines: list[str]) -> None:
    """A last line without its end and with fewer decimals than the one before was cut short."""
    if text.endswith("\n") or len(lines) < 3:
        return
    last, before = (line.rpartition(",")[2].strip() for line in (lines[-1], lines[-2]))
    if len(last.partition(".")[2]) < len(before.partition(".")[2]):
        raise _bad(path, len(lines), "the file ends in the middle of a number")


def _row(path: Path, number: int, line: str) -> list[float]:
    parts = line.split(",")
    if len(parts) != len(COLUMNS):
        raise _bad(path, number, f"{len(parts)} values instead of {len(COLUMNS)}")
    try:
        values = [float(part) for part in parts]
    except ValueError:
        raise _bad(path, number, "a value is not a number") from None
    if not all(math.isfinite(value) for value in values):
        raise _bad(path, number, "a value is not finite")
    if abs(math.hypot(*values[4:]) - 1) > _MAX_NORM_ERROR:
        raise _bad(path, number, "the quaternion's length is not 1")
    if max(map(abs, values[1:4])) > _MAX_POSITION_M:
        raise _bad(path, number, f"a position is over {_MAX_POSITION_M:g} m")
    return values


def _check_steps(path: Path, rows: Array, numbers: list[int]) -> None:
    step = np.diff(rows[:, 0])
    speed = np.linalg.norm(np.diff(rows[:, 1:4], axis=0), axis=1) / np.maximum(step, 1e-9)
    for wrong, why in (
        (step <= 0, "the time does not increase"),
        (step > _MAX_GAP_S, f"a gap of more than {_MAX_GAP_S:g} s before it"),
        (speed > _MAX_SPEED_M_S, f"the mask would move faster than {_MAX_SPEED_M_S:g} m/s"),
    ):
        if wrong.any():
            raise _bad(path, numbers[int(np.argmax(wrong)) + 1], why)


def _bad(path: Path, line: int, why: str) -> DataError:
    return DataError(
        "MOTION-FORMAT", f"{path}, line {line}: {why}", "Mend the file or take another clip."
    )


def _clip(rows: Array) -> Clip:
    """Quaternions are made to follow each other on one side (q and -q are the same turn)."""
    times = rows[:, 0] - rows[0, 0]
    values = rows[:, 1:].copy()
    values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    flips = np.sum(values[1:, 3:] * values[:-1, 3:], axis=1) < 0
    values[1:, 3:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    return Clip(times, values, np.gradient(values, times, axis=0))


@dataclass(frozen=True)
class BuiltIn:
    """A path in closed form. path: t (n,) -> position (n, 3) m, roll, pitch, yaw (n, 3) rad."""

    path: Callable[[Array], tuple[Array, Array]]
    speed: float
    duration_s: float | None = None

    def at(self, times_s: Array) -> tuple[Array, Array]:
        positions, attitudes = self.path(np.asarray(times_s, float) * self.speed)
        return attitude_rotations(attitudes), positions


def attitude_rotations(attitudes: Array) -> Array:
    """(n, 3, 3) rotations Ry(yaw) Rx(pitch) Rz(roll) of (n, 3) roll, pitch, yaw in radians.

    Positive yaw turns the nose to the audience's right, positive pitch down, positive roll
    anti-clockwise.
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(attitudes).T, np.sin(attitudes).T
    return np.stack(
        [
            cy * cr + sy * sp * sr, -cy * sr + sy * sp * cr, sy * cp,
            cp * sr, cp * cr, -sp,
            -sy * cr + cy * sp * sr, sy * sr + cy * sp * cr, cy * cp,
        ],
        axis=1,
    ).reshape(-1, 3, 3)  # fmt: skip


def _wave(t: Array, amplitude: float, rate_hz: float, phase: float = 0.0) -> Array:
    """amplitude * sin, shifted so that it starts at 0."""
    angle = 2 * np.pi * (rate_hz * t + phase)
    wave: Array = amplitude * (np.sin(angle) - math.sin(2 * math.pi * phase))
    return wave


def _path(
    x: Array, y: Array, z: Array, roll: Array, pitch: Array, yaw: Array
) -> tuple[Array, Array]:
    """Columns put together; attitudes come in degrees."""
    return np.stack([x, y, z], axis=1), np.deg2rad(np.stack([roll, pitch, yaw], axis=1))


def _still(t: Array) -> tuple[Array, Array]:
    return np.zeros((len(t), 3)), np.zeros((len(t), 3))


def _sway(t: Array) -> tuple[Array, Array]:
    o = np.zeros_like(t)
    return _path(_wave(t, 0.2, 0.4), o, o, _wave(t, 8, 0.4), o, _wave(t, 12, 0.4))


def _walk(t: Array) -> tuple[Array, Array]:
    """Along a line before the cart at up to 0.4 m/s, two steps a second that bob the head."""
    return _path(
        _wave(t, 0.2, 0.32) + _wave(t, 0.012, 1.0),
        _wave(t, 0.018, 2.0, 0.25),
        _wave(t, 0.1, 0.21),
        _wave(t, 3, 1.0),
        _wave(t, 3, 2.0),
        _wave(t, 20, 0.32, 0.25),
    )


def _spin(t: Array) -> tuple[Array, Array]:
    """The head rolls all the way round in 6 s."""
    o = np.zeros_like(t)
    return _path(o, o, o, 60 * t, o, o)


def _nod(t: Array) -> tuple[Array, Array]:
    pitch = _wave(t, 18, 0.8)
    return _path(0 * t, -0.1 * np.sin(np.deg2rad(pitch)), 0 * t, 0 * t, pitch, _wave(t, 15, 0.17))


def _dance(t: Array) -> tuple[Array, Array]:
    """As lively as the recorded dancers: up to about 1 m/s and 6 m/s^2."""
    return _path(
        _wave(t, 0.13, 0.55) + _wave(t, 0.045, 1.31, 0.1),
        _wave(t, 0.05, 1.1, 0.2) + _wave(t, 0.025, 1.73),
        _wave(t, 0.09, 0.37) + _wave(t, 0.03, 1.19, 0.3),
        _wave(t, 14, 0.55, 0.1) + _wave(t, 5, 1.27),
        _wave(t, 9, 0.83) + _wave(t, 4, 1.61, 0.2),
        _wave(t, 17, 0.47, 0.05) + _wave(t, 6, 1.13),
    )


SWEEP_S = 40.0
NEAR_M, FAR_M = 1.2, 2.4


def _sweep(ray: Array, distance_m: float) -> Callable[[Array], tuple[Array, Array]]:
    """The whole working range, slowly: roll two turns, pitch, yaw and distance to and fro.

    ray: (3,) way in the clips' axes for each metre of distance, so that the mask stays in the
    projector's picture.
    """

    def path(t: Array) -> tuple[Array, Array]:
        phase = t / SWEEP_S
        depth = (NEAR_M + FAR_M) / 2 - (FAR_M - NEAR_M) / 2 * np.cos(2 * np.pi * phase)
        attitudes = np.stack(
            [720 * phase, 20 * np.sin(2 * np.pi * 5 * phase), 30 * np.sin(2 * np.pi * 3 * phase)],
            axis=1,
        )
        return (depth - distance_m)[:, None] * ray, np.deg2rad(attitudes)

    return path


_PATHS = {
    "still": _still,
    "sway": _sway,
    "walk": _walk,
    "spin": _spin,
    "nod": _nod,
    "dance": _dance,
}
BUILT_IN = (*_PATHS, "sweep")


def find_motion(choices: tuple[str, ...], speed: float, ray: Array, distance_m: float) -> Motion:
    """The first of `choices` that is there: a name of `BUILT_IN` or a CSV file.

    Raises `ConfigError` MOTION-ABSENT and `DataError` MOTION-FORMAT.
    """
    for choice in choices:
        if choice == "sweep":
            return BuiltIn(_sweep(ray, distance_m), speed, SWEEP_S / speed)
        if choice in _PATHS:
            return BuiltIn(_PATHS[choice], speed)
        if Path(choice).is_file():
            return load_clip(Path(choice))
    raise ConfigError(
        "MOTION-ABSENT",
        f"there is no motion '{' or '.join(choices)}'",
        f"Name a CSV file or one of {', '.join(BUILT_IN)}.",
    )
