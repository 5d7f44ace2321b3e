"""How long the stage takes to draw and to read back, in milliseconds."""

from __future__ import annotations

import time
from collections.abc import Callable

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.geometry import FACING, Pose, rotation_from_attitude
from hypermask.mask import Mask
from hypermask.stage.layers import Actor, MeshLayer, Positions, dots_actor, relief_mesh
from hypermask.stage.renderer import DrawItem, StageRenderer

SIZE = (1280, 720)
FACE_SPACING_M = 0.0105  # about as many vertices as the paper's face: 500

_FOCAL_PX = 1920.0


def run(
    create_context: Callable[[], moderngl.Context], mask: Mask, frames: int = 300
) -> dict[str, dict[str, float]]:
    """{"face", "cross_fade", "dots", "black", "read_back": {"p50", "p99" (ms), "vertices"}}.

    create_context: gives the GLES context; it is released at the end. Drawn at 1.8 m, turning,
    each draw until the GPU has finished.
    """
    context = create_context()
    renderer = StageRenderer(context, SIZE, mask)
    with context:
        framebuffer = context.framebuffer(
            [context.texture(SIZE, 4)], context.depth_renderbuffer(SIZE)
        )
    face, face_positions = face_like_actor(mask)
    dots, dots_positions = dots_actor(mask, noise_texture(1024))
    for key, actor in (("face", face), ("dots", dots)):
        renderer.load(key, actor)
    for _ in renderer.dress("other", "face", renderer.costume(face)):
        pass
    scenes = {
        "face": [DrawItem("face", face_positions)],
        "cross_fade": [
            DrawItem("face", face_positions, 0.5),
            DrawItem("other", face_positions, 0.5),
        ],
        "dots": [DrawItem("dots", dots_positions)],
        "black": [],
    }
    result: dict[str, dict[str, float]] = {}
    for name, items in scenes.items():
        times = [_timed_draw(context, renderer, framebuffer, k, items) for k in range(frames)]
        vertices = sum(len(part) for item in items for part in item.positions)
        result[name] = {**_percentiles(times), "vertices": float(vertices)}
    with context:
        times = [_timed(lambda: framebuffer.read(components=4)) for _ in range(frames)]
    result["read_back"] = _percentiles(times)
    context.release()
    return result


def face_like_actor(mask: Mask) -> tuple[Actor, tuple[Positions, ...]]:
    """The relief with about 500 vertices and a 1024 x 1024 texture."""
    positions, triangles = relief_mesh(mask, FACE_SPACING_M)
    half = np.array(mask.half_size_m)
    uv = (positions[:, :2] * [1, -1] + half) / (2 * half)
    layer = MeshLayer("face", triangles, uv.astype(np.float32), noise_texture(1024))
    return Actor((layer,)), (positions,)


def noise_texture(size: int) -> NDArray[np.uint8]:
    """(size, size, 4) opaque noise: the worst case for texture caches."""
    texture = np.random.default_rng(0).integers(0, 256, (size, size, 4), dtype=np.uint8)
    texture[..., 3] = 255
    return texture


def _turning(frame: int) -> NDArray[np.float64]:
    """(3, 4) projector_from_mask of a mask at 1.8 m that turns from frame to frame."""
    roll, yaw = 0.1 * np.sin(frame / 20), 0.5 * np.sin(frame / 30)
    pose = Pose(FACING @ rotation_from_attitude(roll, 0.0, yaw), np.array([0.0, -0.33, 1.8]))
    matrix = np.array([[_FOCAL_PX, 0, 639.5], [0, _FOCAL_PX, 719.5], [0, 0, 1.0]])
    return np.asarray(matrix @ pose.matrix())


def _timed_draw(
    context: moderngl.Context,
    renderer: StageRenderer,
    framebuffer: moderngl.Framebuffer,
    frame: int,
    items: list[DrawItem],
) -> float:
    def draw() -> None:
        renderer.draw(framebuffer, _turning(frame), items)
        context.finish()

    return _timed(draw)


def _timed(action: Callable[[], object]) -> float:
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


def _percentiles(times: list[float]) -> dict[str, float]:
    kept = times[len(times) // 10 :]  # the first ones compile shaders
    return {name: round(float(np.percentile(kept, q)) * 1e3, 3) for name, q in _QUANTILES.items()}


_QUANTILES = {"p50": 50, "p99": 99}
