"""Times of the tracker beside OpenCV's SimpleBlobDetector, on the same frames in one run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from hypermask.geometry import FACING, Array, Pinhole, Pose, rotation_from_attitude
from hypermask.tracking.blobs import Image, find_blobs
from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.tracker import Tracker, TrackerSettings

CAMERA = Pinhole.from_focal(900.0, (639.5, 399.5), (1280, 800))
RATE_HZ = 120.0
REFERENCE_LEDS: Array = np.array(
    [
        [-0.080, 0.110, 0.0],
        [0.080, 0.110, 0.0],
        [0.080, -0.110, 0.0],
        [-0.080, -0.110, 0.0],
        [0.0, -0.022, 0.040],
    ]
)
_REFLECTIONS = np.array([[90, 80], [1130, 150], [260, 690], [1010, 640], [640, 60], [70, 430]])


def run(
    frames: int | Sequence[tuple[Image, float]] = 300,
    leds: Array = REFERENCE_LEDS,
    camera: Pinhole = CAMERA,
) -> dict[str, Any]:
    """Milliseconds a frame, p50 and p99, single thread.

    frames: how many to draw (a head that sways and turns, six reflections, noise of 2 grey
    levels), or frames (image, mid-exposure time) of the caller's own.
    Returns {"frames", "size", "locked", "searching", "simple_blob_detector_tuned",
    "simple_blob_detector_default"}; "locked" and "searching" are whole frames of `Tracker`, pose
    and motion filter included, and carry the share of frames with the mask found.
    """
    drawn = draw_frames(frames, leds, camera) if isinstance(frames, int) else list(frames)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return {
            "frames": len(drawn),
            "size": list(camera.size),
            "locked": _locked(drawn, leds, camera),
            "searching": _searching(drawn, leds, camera),
            "extraction_full_frame": _timed(
                drawn, lambda image: len(find_blobs(image, TrackerSettings().blobs).points)
            ),
            "simple_blob_detector_tuned": _timed(drawn, _detector(tuned=True)),
            "simple_blob_detector_default": _timed(
                drawn[: max(1, len(drawn) // 4)], _detector(tuned=False)
            ),
        }
    finally:
        cv2.setNumThreads(threads)


def draw_frames(count: int, leds: Array, camera: Pinhole) -> list[tuple[Image, float]]:
    """Frames of a mask that sways at 1.8 m, with the time of each."""
    rng = np.random.default_rng(1)
    width, height = camera.size
    noise = 10 + 2 * rng.standard_normal((height + 64, width)).astype(np.float32)
    drawn = []
    for j in range(count):
        t = j / RATE_HZ
        points = camera.project(_swaying(t).apply(leds))
        scene = noise[(j * 29) % 64 :][:height].copy()
        for x, y in np.concatenate([points, _REFLECTIONS]):
            _add_spot(scene, x, y)
        drawn.append((np.clip(np.rint(scene), 0, 255).astype(np.uint8), t))
    return drawn


def _swaying(t: float) -> Pose:
    roll, pitch, yaw = 0.2 * np.sin(2.1 * t), 0.2 * np.sin(2.9 * t), 0.4 * np.sin(3.7 * t)
    place = [0.15 * np.sin(3.0 * t), 0.05 * np.sin(5.0 * t), 1.8 + 0.1 * np.sin(1.7 * t)]
    return Pose(FACING @ rotation_from_attitude(roll, pitch, yaw), np.array(place))


def _add_spot(scene: Any, x: float, y: float, peak: float = 160.0, width: float = 1.4) -> None:
    x0, y0 = int(x) - 7, int(y) - 7
    gx = np.exp(-0.5 * ((np.arange(x0, x0 + 16) - x) / width) ** 2)
    gy = np.exp(-0.5 * ((np.arange(y0, y0 + 16) - y) / width) ** 2)
    scene[y0 : y0 + 16, x0 : x0 + 16] += peak * gy[:, None] * gx


def _locked(frames: list[tuple[Image, float]], leds: Array, camera: Pinhole) -> dict[str, float]:
    tracker = Tracker(leds, camera, TrackerSettings(), MotionFilter())
    times, found = [], 0
    for number, (image, when) in enumerate(frames):
        start = time.perf_counter()
        result = tracker.process(image, when, number)
        spent = time.perf_counter() - start
        if result.locked and not result.searching:
            times.append(spent)
            found += result.estimate is not None
    return _summary(times) | {"found": found / max(1, len(times))}


def _searching(frames: list[tuple[Image, float]], leds: Array, camera: Pinhole) -> dict[str, float]:
    """Every frame to a tracker that knows nothing yet."""
    tracker = Tracker(leds, camera, TrackerSettings(), MotionFilter())
    times, found = [], 0
    for number, (image, when) in enumerate(frames):
        tracker.reset()
        start = time.perf_counter()
        result = tracker.process(image, when, number)
        times.append(time.perf_counter() - start)
        found += not np.isnan(result.points).any()
    return _summary(times) | {"found": found / max(1, len(times))}


def _timed(frames: list[tuple[Image, float]], detect: Callable[[Image], int]) -> dict[str, float]:
    times = []
    for image, _ in frames:
        start = time.perf_counter()
        detect(image)
        times.append(time.perf_counter() - start)
    return _summary(times)


def _detector(tuned: bool) -> Callable[[Image], int]:
    parameters = cv2.SimpleBlobDetector.Params()
    if tuned:
        # One threshold and no filter but the area: the least it can do and still find the LEDs.
        parameters.minThreshold, parameters.maxThreshold = 40, 41
        parameters.thresholdStep = 10
        parameters.minRepeatability = 1
        parameters.minDistBetweenBlobs = 5
        parameters.blobColor = 255
        parameters.filterByArea, parameters.minArea, parameters.maxArea = True, 4, 1500
        parameters.filterByCircularity = False
        parameters.filterByConvexity = parameters.filterByInertia = False
    detector = cv2.SimpleBlobDetector.create(parameters)
    return lambda image: len(detector.detect(image))


def _summary(seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {"p50_ms": float("nan"), "p99_ms": float("nan")}
    p50, p99 = np.percentile(np.array(seconds) * 1e3, [50, 99])
    return {"p50_ms": round(float(p50), 4), "p99_ms": round(float(p99), 4)}
