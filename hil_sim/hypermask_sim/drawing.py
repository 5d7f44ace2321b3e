"""Text, boxes and curves on a page, smooth: drawn large and made small again.

OpenCV's FreeType module is not in every build of it, so letters are its own Hershey strokes.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

SUPERSAMPLING = 4
FONT = cv2.FONT_HERSHEY_DUPLEX
_SHIFT = 4
_PLAIN = str.maketrans({"±": "+-", "°": " deg", "–": "-", "—": "-", "×": "x", "µ": "u", "≤": "<="})


def plain(text: str) -> str:
    """The text in the 95 characters that the strokes can draw."""
    folded = unicodedata.normalize("NFKD", text.translate(_PLAIN))
    return "".join(c for c in folded if 32 <= ord(c) < 127)


def text_width(text: str, size: float) -> float:
    """Width in pixels of a text whose capitals are `size` pixels high."""
    return _extent(plain(text), size)[0] / SUPERSAMPLING


def _extent(text: str, size: float) -> tuple[int, int]:
    width, _ = cv2.getTextSize(text, FONT, _scale(size), 1)[0]
    return int(width), round(size * SUPERSAMPLING)


def _scale(size: float) -> float:
    return float(size * SUPERSAMPLING / 21)  # Hershey capitals are 21 units high


def put_text(
    page: Picture,
    text: str,
    place: tuple[float, float],
    size: float,
    colour: Colour,
    weight: float = 1.0,
    align: str = "left",
) -> None:
    """Write on `page` (h, w, 3); place: (x, baseline y); size: height of capitals in pixels."""
    letters = plain(text)
    if not letters:
        return
    width, height = _extent(letters, size)
    pad = SUPERSAMPLING * 4
    shape = _whole(height + height // 2 + 2 * pad), _whole(width + 2 * pad)
    ink = np.zeros(shape, np.uint8)
    stroke = max(1, round(size * SUPERSAMPLING * 0.105 * weight))
    cv2.putText(ink, letters, (pad, pad + height), FONT, _scale(size), 255, stroke, cv2.LINE_AA)
    small = cv2.resize(
        ink,
        (shape[1] // SUPERSAMPLING, shape[0] // SUPERSAMPLING),
        interpolation=cv2.INTER_AREA,
    )
    left = place[0] - {"left": 0.0, "middle": 0.5, "right": 1.0}[align] * width / SUPERSAMPLING
    x = round(left) - pad // SUPERSAMPLING
    y = round(place[1]) - (pad + height) // SUPERSAMPLING
    blend(page, np.asarray(small, np.uint8), (x, y), colour)


def _whole(length: int) -> int:
    return -(-length // SUPERSAMPLING) * SUPERSAMPLING


def blend(page: Picture, cover: NDArray[np.uint8], place: tuple[int, int], colour: Colour) -> None:
    """Lay `colour` on the page where `cover` (h, w) says, 255 = opaque; cut at the page's edges."""
    x, y = place
    top, left = max(0, -y), max(0, -x)
    bottom = min(cover.shape[0], page.shape[0] - y)
    right = min(cover.shape[1], page.shape[1] - x)
    if bottom <= top or right <= left:
        return
    area = page[y + top : y + bottom, x + left : x + right]
    alpha = cover[top:bottom, left:right, None].astype(np.float32) / 255
    area[:] = np.round(area + alpha * (np.array(colour, np.float32) - area)).astype(np.uint8)


def box(page: Picture, corner: tuple[int, int], size: tuple[int, int], colour: Colour) -> None:
    (x, y), (width, height) = corner, size
    page[y : y + height, x : x + width] = colour


def curve(
    page: Picture, points: ArrayLike, colour: Colour, width_px: float = 1.5, opacity: float = 1.0
) -> None:
    """A smooth line through points (N, 2) px; NaN breaks it, a lone point becomes a dot."""
    pts = np.asarray(points, float).reshape(-1, 2)
    cover = np.zeros(page.shape[:2], np.uint8)
    large = cv2.resize(cover, None, fx=2, fy=2)
    finite = np.isfinite(pts).all(axis=1)
    for run in np.split(np.arange(len(pts)), np.flatnonzero(~finite)):
        kept = run[finite[run]]
        if not len(kept):
            continue
        fixed = np.round((pts[kept] * 2 + 0.5) * (1 << _SHIFT)).astype(np.int32)
        thickness = max(1, round(width_px * 2))
        if len(fixed) == 1:
            radius = round(width_px * (1 << _SHIFT))
            cv2.circle(large, fixed[0].tolist(), radius, 255, -1, cv2.LINE_AA, _SHIFT)
        else:
            cv2.polylines(large, [fixed], False, 255, thickness, cv2.LINE_AA, _SHIFT)
    cover = np.asarray(cv2.resize(large, page.shape[1::-1], interpolation=cv2.INTER_AREA), np.uint8)
    blend(page, np.asarray(cover * opacity, np.uint8), (0, 0), colour)


def ring(page: Picture, centre: Sequence[float], radius: float, colour: Colour) -> None:
    """A thin circle, for pointing at something small."""
    point = tuple(round(v * (1 << _SHIFT)) for v in centre)
    cv2.circle(page, point, round(radius * (1 << _SHIFT)), colour, 1, cv2.LINE_AA, _SHIFT)


def fit(picture: Picture, size: tuple[int, int]) -> Picture:
    """The picture scaled into (width, height) without distortion, black around it."""
    scale = min(size[0] / picture.shape[1], size[1] / picture.shape[0])
    width, height = (max(1, round(n * scale)) for n in picture.shape[1::-1])
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    small = cv2.resize(picture, (width, height), interpolation=method)
    framed = np.zeros((size[1], size[0], *picture.shape[2:]), np.uint8)
    x, y = (size[0] - width) // 2, (size[1] - height) // 2
    framed[y : y + height, x : x + width] = small
    return framed
