"""A few lines that draw LEDs, so that the tracker's tests need no simulator."""

from __future__ import annotations

import numpy as np

from hypermask.geometry import FACING, Pinhole, Pose, rotation_from_attitude

LEDS = np.array(
    [
        [-0.080, 0.110, 0.0],
        [0.080, 0.110, 0.0],
        [0.080, -0.110, 0.0],
        [-0.080, -0.110, 0.0],
        [0.0, -0.022, 0.040],
    ]
)
CAMERA = Pinhole.from_focal(900.0, (639.5, 399.5), (1280, 800))


def camera_from_mask(x, y, z, roll=0.0, pitch=0.0, yaw=0.0) -> Pose:
    """Angles in degrees; seen straight on, not along the line of sight."""
    attitude = rotation_from_attitude(*np.radians([roll, pitch, yaw]))
    return Pose(FACING @ attitude, np.array([x, y, z]))


def draw(points, peaks=160.0, width=1.4, background=10.0, noise=2.0, rng=None, into=None):
    """A frame (800, 1280) uint8 with Gaussian spots at points (n, 2); NaN is not drawn."""
    scene = np.full((800, 1280), background, np.float32) if into is None else into
    peaks = np.broadcast_to(np.asarray(peaks, float), len(points))
    widths = np.broadcast_to(np.asarray(width, float), len(points))
    for (x, y), peak, sigma in zip(points, peaks, widths, strict=True):
        if not (-20 < x < 1300 and -20 < y < 820):
            continue
        r = int(np.ceil(5 * sigma)) + 1
        x0, x1 = max(0, int(x) - r), min(1280, int(x) + r + 2)
        y0, y1 = max(0, int(y) - r), min(800, int(y) + r + 2)
        if x1 <= x0 or y1 <= y0:
            continue
        gx = np.exp(-0.5 * ((np.arange(x0, x1) - x) / sigma) ** 2)
        gy = np.exp(-0.5 * ((np.arange(y0, y1) - y) / sigma) ** 2)
        scene[y0:y1, x0:x1] += (peak * gy[:, None] * gx).astype(np.float32)
    if rng is not None and noise > 0:
        scene = scene + noise * noise_bank(rng)
    return np.clip(np.rint(scene), 0, 255).astype(np.uint8)


_BANK: list[np.ndarray] = []


def noise_bank(rng):
    """Read noise of one frame: rows of a fixed field, shifted at random (cheap, deterministic)."""
    if not _BANK:
        _BANK.append(np.random.default_rng(7).standard_normal((1700, 1280)).astype(np.float32))
    start = int(rng.integers(900))
    return np.roll(_BANK[0][start : start + 800], int(rng.integers(1280)), axis=1)
