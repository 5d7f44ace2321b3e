"""A picture of speech and mouth: sound, phones, opening and the thirteen parameters over time."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.mouth import MOUTH_PARAMETERS
from hypermask.voice.align import OPEN, Track
from hypermask.voice.synthesis import Phone
from hypermask.voice.visemes import LIPS

_PER_S = 300  # pixels
_LEFT, _RIGHT = 200, 20
_WAVE, _PHONES, _OPENING, _ROW, _AXIS = 130, 34, 130, 30, 34
_MOST_WIDTH = 8000
_INK, _GREY, _RED, _BLUE = (40, 40, 40), (215, 215, 215), (40, 40, 200), (170, 90, 20)
_FONT = cv2.FONT_HERSHEY_SIMPLEX

_Picture = NDArray[np.uint8]


def draw(
    sound: NDArray[np.floating],
    rate_hz: float,
    track: Track,
    arousal: NDArray[np.floating],
    phones: Sequence[Phone] = (),
) -> _Picture:
    """(height, width, 3) uint8 BGR."""
    length_s = max(len(sound) / rate_hz, 0.2)
    scale = min(_PER_S, (_MOST_WIDTH - _LEFT - _RIGHT) / length_s)
    width = int(_LEFT + scale * length_s + _RIGHT)
    height = _WAVE + _PHONES + _OPENING + _ROW * (len(MOUTH_PARAMETERS) + 1) + _AXIS
    picture = np.full((height, width, 3), 255, np.uint8)
    top = _WAVE + _PHONES
    _shade_closures(picture, phones, scale, height - _AXIS)
    _wave(picture, sound, rate_hz, scale)
    _phones(picture, phones, scale)
    _label(picture, "opening (half widths)", top + _OPENING // 2)
    _curve(
        picture, track.time_s, track.opening / 1.3, scale, top + _OPENING - 6, _OPENING - 12, _RED
    )
    level = int(top + _OPENING - 6 - OPEN / 1.3 * (_OPENING - 12))
    cv2.line(picture, (_LEFT, level), (width - _RIGHT, level), _GREY, 1)
    for k, name in enumerate(MOUTH_PARAMETERS):
        middle = top + _OPENING + _ROW * k + _ROW // 2
        _label(picture, name, middle)
        cv2.line(picture, (_LEFT, middle), (width - _RIGHT, middle), _GREY, 1)
        _curve(picture, track.time_s, track.parameters[:, k], scale, middle, _ROW * 0.9, _BLUE)
    middle = top + _OPENING + _ROW * len(MOUTH_PARAMETERS) + _ROW // 2
    _label(picture, "arousal", middle)
    _curve(picture, track.time_s, arousal, scale, middle + _ROW // 2 - 3, _ROW - 6, _INK)
    _axis(picture, length_s, scale, height - _AXIS)
    return picture


def _x(time_s: float, scale: float) -> int:
    return int(_LEFT + scale * time_s)


def _label(picture: _Picture, text: str, middle: int) -> None:
    cv2.putText(picture, text, (6, middle + 4), _FONT, 0.4, _INK, 1, cv2.LINE_AA)


def _wave(picture: _Picture, sound: NDArray[np.floating], rate_hz: float, scale: float) -> None:
    _label(picture, "sound", _WAVE // 2)
    loudest = max(float(np.max(np.abs(sound), initial=0)), 1e-6)
    columns = np.arange(int(scale * len(sound) / rate_hz))
    edges = (columns / scale * rate_hz).astype(int)
    for column, part in zip(columns, np.split(sound, edges[1:]), strict=False):
        if len(part):
            x = _LEFT + int(column)
            high, low = (_WAVE / 2 - 0.47 * _WAVE * v / loudest for v in (part.max(), part.min()))
            cv2.line(picture, (x, int(high)), (x, int(low)), _INK, 1)


def _phones(picture: _Picture, phones: Sequence[Phone], scale: float) -> None:
    for phone in phones:
        left = _x(phone.begin_s, scale)
        cv2.line(picture, (left, _WAVE), (left, _WAVE + _PHONES), _GREY, 1)
        text = phone.label.encode("ascii", "replace").decode()
        cv2.putText(picture, text, (left + 2, _WAVE + 22), _FONT, 0.38, _INK, 1, cv2.LINE_AA)


def _shade_closures(picture: _Picture, phones: Sequence[Phone], scale: float, bottom: int) -> None:
    for phone in phones:
        if phone.classes and phone.classes[0] == LIPS:
            left, right = _x(phone.begin_s, scale), _x(phone.end_s, scale)
            picture[_WAVE:bottom, left:right] = (225, 240, 225)


def _curve(
    picture: _Picture,
    time_s: NDArray[np.floating],
    values: NDArray[np.floating],
    scale: float,
    zero: float,
    height: float,
    colour: tuple[int, int, int],
) -> None:
    x = _LEFT + scale * time_s
    y = zero - height * np.clip(values, -1.2, 1.2)
    line = np.stack([x, y], axis=1).round().astype(np.int32)
    cv2.polylines(picture, [line], False, colour, 1, cv2.LINE_AA)


def _axis(picture: _Picture, length_s: float, scale: float, top: int) -> None:
    step = 0.1 if length_s < 8 else 1.0
    for k in range(int(length_s / step) + 1):
        x = _x(k * step, scale)
        cv2.line(picture, (x, top), (x, top + 6), _INK, 1)
        if k % 5 == 0:
            text = f"{k * step:.1f} s"
            cv2.putText(picture, text, (x - 12, top + 22), _FONT, 0.4, _INK, 1, cv2.LINE_AA)
