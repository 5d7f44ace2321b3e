"""A turned face's texture brought into register with the morphable model.

On a turned head the landmark model is off by several percent of the pupils' distance, most on the
far side, and always in the same sense; no shape that is fitted to its points alone can tell. The
texture can: dense optical flow (Farneback 2003) between the photograph in the layout and what the
morphable model makes of it, smoothed where there is nothing to hold on to, says where each
texel lies.
"""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.texture import regions
from hypermask.texture.estimate import estimate, small
from hypermask.texture.morphable import SIDE, MorphableModel

Map = NDArray[np.float32]
Image = NDArray[np.uint8]

FROM_DEG, FULL_DEG = 8.0, 14.0
"""Off the front by less, the landmarks are better than the flow; by more, the flow counts fully."""
_ROUNDS = 2
_SMOOTH = 8.0
_MOST = 10.0
"""Texels of the model that anything is moved by."""
_WINDOW = 25


def shift(model: MorphableModel, texture: Image, weight: Map, off_front_deg: float) -> Map | None:
    """(SIDE, SIDE, 2) how far beside each texel, in texels of the model, its skin lies; or None.

    texture: (h, w, 3) BGR in the layout; weight: (h, w) how far it is believed.
    """
    share = float(np.clip((off_front_deg - FROM_DEG) / (FULL_DEG - FROM_DEG), 0, 1))
    if share <= 0:
        return None
    first, believed = small(texture), small(weight)
    seen, total = first, np.zeros((SIDE, SIDE, 2), np.float32)
    for _ in range(_ROUNDS):
        found = estimate(model, seen, believed)
        flow = _flow(found.modelled, seen)
        trust = np.minimum(believed, found.weight) * _inside() * _detail(found.modelled)
        total = np.clip(total + _smoothed(flow, trust), -_MOST, _MOST)
        seen = moved(first, total)
    return np.asarray(total * share, np.float32)


def moved(values: Map, shift: Map) -> Map:
    """A map of the layout (n, n, c) read at the places that `shift` says."""
    side = values.shape[0]
    scale = side / SIDE
    beside = shift if scale == 1 else cv2.resize(shift, (side, side)) * scale
    ys, xs = np.mgrid[:side, :side].astype(np.float32)
    place = xs + beside[..., 0], ys + beside[..., 1]
    read = cv2.remap(values, *place, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    return np.asarray(read, np.float32)


def _flow(modelled: Map, seen: Map) -> Map:
    target, texture = (
        cv2.cvtColor(np.clip(t, 0, 255).astype(np.uint8), cv2.COLOR_BGR2GRAY)
        for t in (modelled, seen)
    )
    start = np.zeros((SIDE, SIDE, 2), np.float32)
    flow = cv2.calcOpticalFlowFarneback(target, texture, start, 0.5, 3, _WINDOW, 3, 7, 1.5, 0)
    return np.asarray(flow, np.float32)


def _detail(modelled: Map) -> Map:
    """Where the flow has something to hold on to."""
    grey = cv2.GaussianBlur(cv2.cvtColor(modelled, cv2.COLOR_BGR2GRAY), (0, 0), 2)
    edges = np.abs(cv2.Laplacian(grey, cv2.CV_32F))
    return np.asarray(cv2.GaussianBlur(edges, (0, 0), 4) + 0.05, np.float32)


def _smoothed(flow: Map, trust: Map) -> Map:
    share = cv2.GaussianBlur(trust, (0, 0), _SMOOTH)
    wide = cv2.GaussianBlur(flow * trust[..., None], (0, 0), _SMOOTH)
    return np.asarray(wide / (share + 1e-3)[..., None], np.float32)


@functools.cache
def _inside() -> Map:
    return regions.ramp(small(regions.depth_mm()), 2, 10)
