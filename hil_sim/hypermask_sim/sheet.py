"""The contact sheet: one page that shows a rehearsal at a glance.

Title, key figures, moments (audience, projector, camera) and the registration error over time.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask_drivers.errors import HypermaskError
from hypermask_sim import drawing
from hypermask_sim.drawing import Colour, Picture, blend, box, curve, fit, put_text, ring

PAPER: Colour = (18, 19, 23)
CARD: Colour = (30, 32, 38)
INK: Colour = (236, 236, 232)
FAINT: Colour = (146, 149, 158)
LINE: Colour = (58, 61, 70)
ACCENT: Colour = (255, 190, 92)
GOOD: Colour = (126, 211, 140)
BAD: Colour = (255, 112, 98)
LED: Colour = (110, 230, 150)

WIDTH, MARGIN, GAP = 1680, 48, 20
COLUMNS = 3
CARD_HEIGHT = 104
PLOT_HEIGHT = 300
CAPTION_HEIGHT = 34
HEAD_REACH_DEG = (50.0, 28.0)
INSET = (10, 16)  # height to width of the two small pictures beneath the audience's


@dataclass(frozen=True)
class KeyFigure:
    """label: what it is; value: as it is to be read; good: whether it meets its limit, if any."""

    label: str
    value: str
    note: str = ""
    good: bool | None = None


@dataclass(frozen=True)
class Moment:
    """audience, projector: RGB (h, w, 3), row 0 at the top; camera: the infrared frame (h, w).

    leds: (n, 2) px in the camera frame, where the program sees them (NaN: unseen). head_deg: pan
    and tilt of a head on a pan-tilt unit; shown where there is no camera.
    """

    time_s: float
    caption: str
    audience: Picture
    projector: Picture | None = None
    camera: NDArray[np.uint8] | None = None
    leds: NDArray[np.float64] | None = None
    head_deg: tuple[float, float] | None = None


def contact_sheet(
    title: str,
    subtitle: str,
    figures: Sequence[KeyFigure],
    moments: Sequence[Moment],
    errors: Sequence[tuple[float, float]] = (),
    events: Sequence[tuple[float, str]] = (),
    path: Path | None = None,
) -> Picture:
    """The page (height, 1680, 3) uint8 RGB; with `path` also written as PNG.

    errors: (time s, rms mm) of each frame, NaN where none could be measured; events: (time s,
    text), marked in the plot. Raises `HypermaskError` SHEET-WRITE.
    """
    cell = _cell_size()
    rows = -(-len(moments) // COLUMNS)
    top = MARGIN + 78
    grid = top + (CARD_HEIGHT + GAP if figures else 0)
    plot = grid + rows * (cell[1] + GAP)
    height = plot + (PLOT_HEIGHT if errors else 0) + MARGIN
    page = np.full((height, WIDTH, 3), PAPER, np.uint8)
    put_text(page, title, (MARGIN, MARGIN + 26), 26, INK, 1.15)
    put_text(page, subtitle, (MARGIN, MARGIN + 56), 12, FAINT)
    if figures:
        _draw_figures(page, figures, top)
    for index, moment in enumerate(moments):
        row, column = divmod(index, COLUMNS)
        corner = (MARGIN + column * (cell[0] + GAP), grid + row * (cell[1] + GAP))
        _draw_moment(page, moment, index + 1, corner)
    if errors:
        times = [moment.time_s for moment in moments]
        _draw_plot(page, np.array(errors, float), times, events, plot)
    if path is not None:
        write_png(path, page)
    return page


def write_png(path: Path, picture: Picture) -> None:
    """Write an RGB picture to a temporary file, then rename. Raises `HypermaskError`."""
    done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    assert done
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as file:
            file.write(data.tobytes())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except OSError as error:
        raise HypermaskError(
            "SHEET-WRITE",
            f"cannot write {path}: {error.strerror or error}",
            "Free some space or check the folder's rights.",
        ) from error


def camera_view(
    frame: NDArray[np.uint8], size: tuple[int, int], leds: ArrayLike | None = None
) -> Picture:
    """The infrared frame (h, w) as RGB of `size` (width, height), LEDs circled.

    Points of light stay visible however small the picture: each takes the brightest of its pixels.
    """
    scale = min(size[0] / frame.shape[1], size[1] / frame.shape[0])
    reach = max(1, int(np.ceil(1 / scale)))
    spread = cv2.dilate(frame, np.ones((reach, reach), np.uint8))
    grey = fit(np.asarray(spread, np.uint8), size)
    view: Picture = np.repeat(grey[..., None], 3, axis=2)
    offset = (np.array(size) - np.round(np.array(frame.shape[1::-1]) * scale)) / 2
    for point in np.asarray(leds if leds is not None else [], float).reshape(-1, 2):
        if np.isfinite(point).all():
            ring(view, (point + 0.5) * scale - 0.5 + offset, 5.5, LED)
    return view


def _cell_size() -> tuple[int, int]:
    width = (WIDTH - 2 * MARGIN - (COLUMNS - 1) * GAP) // COLUMNS
    return width, width * 3 // 4 + _inset_size()[1] + CAPTION_HEIGHT


def _inset_size() -> tuple[int, int]:
    width = (WIDTH - 2 * MARGIN - (COLUMNS - 1) * GAP) // COLUMNS // 2
    return width, width * INSET[0] // INSET[1]


def _draw_figures(page: Picture, figures: Sequence[KeyFigure], top: int) -> None:
    width = (WIDTH - 2 * MARGIN - (len(figures) - 1) * GAP) // len(figures)
    for index, figure in enumerate(figures):
        x = MARGIN + index * (width + GAP)
        box(page, (x, top), (width, CARD_HEIGHT), CARD)
        colour = INK if figure.good is None else GOOD if figure.good else BAD
        box(page, (x, top), (4, CARD_HEIGHT), ACCENT if figure.good is None else colour)
        put_text(page, figure.label, (x + 20, top + 28), 10, FAINT)
        size = min(21, 21 * (width - 36) / max(drawing.text_width(figure.value, 21), 1))
        put_text(page, figure.value, (x + 20, top + 64), size, colour, 1.1)
        put_text(page, figure.note, (x + 20, top + 88), 9, FAINT)


def _draw_moment(page: Picture, moment: Moment, number: int, corner: tuple[int, int]) -> None:
    x, y = corner
    width, height = _cell_size()
    box(page, corner, (width, height), CARD)
    view = (width, width * 3 // 4)
    page[y : y + view[1], x : x + width] = fit(moment.audience, view)
    small = _inset_size()
    under = y + view[1]
    box(page, (x, under), (width, small[1]), (0, 0, 0))
    if moment.projector is not None:
        page[under : under + small[1], x : x + small[0]] = fit(moment.projector, small)
    if moment.camera is not None:
        right = x + width - small[0]
        camera = camera_view(moment.camera, small, moment.leds)
        page[under : under + small[1], right : right + small[0]] = camera
    box(page, (x + width // 2, under), (1, small[1]), LINE)
    box(page, (x, under), (width, 1), LINE)
    put_text(page, "projector", (x + 10, under + 18), 8, FAINT)
    beside = "infrared camera"
    if moment.camera is None and moment.head_deg is not None:
        beside = f"head  pan {moment.head_deg[0]:+.0f}  tilt {moment.head_deg[1]:+.0f} deg"
        _draw_head(page, moment.head_deg, (x + width // 2, under), small)
    put_text(page, beside, (x + width // 2 + 10, under + 18), 8, FAINT)
    base = y + height - 12
    put_text(page, f"{number}", (x + 14, base), 11, ACCENT, 1.2)
    put_text(page, f"{moment.time_s:.2f} s", (x + 40, base), 11, INK)
    put_text(page, moment.caption, (x + 122, base), 11, FAINT)


def _draw_head(
    page: Picture, head_deg: tuple[float, float], corner: tuple[int, int], size: tuple[int, int]
) -> None:
    """Where the head looks as the audience sees it: pan to its left is to their right."""
    middle = np.array([corner[0] + size[0] / 2, corner[1] + size[1] / 2 + 8])
    scale = min(size[0] / (2 * HEAD_REACH_DEG[0]), (size[1] - 30) / (2 * HEAD_REACH_DEG[1]))
    half = np.array(HEAD_REACH_DEG) * scale
    for at, span in (((-half[0], 0), (2 * half[0], 1)), ((0, -half[1]), (1, 2 * half[1]))):
        left, top = np.round(middle + at).astype(int)
        box(page, (int(left), int(top)), (max(int(span[0]), 1), max(int(span[1]), 1)), LINE)
    place = np.clip(np.array([head_deg[0], -head_deg[1]]) * scale, -half, half)
    ring(page, [float(v) for v in middle + place], 7.0, ACCENT)


def _draw_plot(
    page: Picture,
    errors: NDArray[np.float64],
    moments: Sequence[float],
    events: Sequence[tuple[float, str]],
    top: int,
) -> None:
    box(page, (MARGIN, top), (WIDTH - 2 * MARGIN, PLOT_HEIGHT), CARD)
    heading = "Registration error on the mask"
    beside = MARGIN + 40 + drawing.text_width(heading, 12)
    put_text(page, heading, (MARGIN + 20, top + 30), 12, INK)
    put_text(page, "rms over the dots of each frame, mm", (beside, top + 30), 9, FAINT)
    left, right = MARGIN + 64, WIDTH - MARGIN - 24
    low, high = top + PLOT_HEIGHT - 40, top + 62
    times, values = errors.T
    start, stop = float(times[0]), max(float(times[-1]), float(times[0]) + 1e-3)
    seen = values[np.isfinite(values)]
    step = _tick(float(np.percentile(seen, 99.5)) * 1.15 if seen.size else 1.0, 4)
    limit = step * max(1, np.ceil(float(seen.max() if seen.size else 1.0) / step))
    limit = min(limit, step * 6)

    def to_x(time: ArrayLike) -> NDArray[np.float64]:
        return left + (np.asarray(time, float) - start) / (stop - start) * (right - left)

    def to_y(value: ArrayLike) -> NDArray[np.float64]:
        share = np.clip(np.asarray(value, float) / limit, 0, 1)
        return np.asarray(low - share * (low - high))

    for value in np.arange(0, limit + step / 2, step):
        y = round(float(to_y(value)))
        box(page, (left, y), (right - left, 1), LINE)
        put_text(page, f"{value:g}", (left - 12, y + 4), 9, FAINT, align="right")
    pace = _tick(stop - start, 10)
    for time in np.arange(np.ceil(start / pace) * pace, stop + pace / 100, pace):
        put_text(page, f"{time:g} s", (float(to_x(time)), low + 24), 9, FAINT, align="middle")
    _shade_gaps(page, times, values, to_x(times), (high, low))
    _mark_events(page, [(float(to_x(t)), text) for t, text in events if start <= t <= stop], high)
    for number, time in enumerate(moments, 1):
        x = float(to_x(np.clip(time, start, stop)))
        curve(page, [[x, high - 4], [x, low]], ACCENT, 1, 0.45)
        put_text(page, str(number), (x, high - 10), 9, ACCENT, 1.2, "middle")
    curve(page, np.column_stack([to_x(times), to_y(values)]), GOOD, 1.6)


def _shade_gaps(
    page: Picture,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    x: NDArray[np.float64],
    span: tuple[int, int],
) -> None:
    """Where nothing could be measured: the picture is black, or no dots are in it."""
    missing = ~np.isfinite(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.view(np.int8), [0]])))
    for first, after in edges.reshape(-1, 2):
        begin = round(x[max(first - 1, 0)])
        end = round(x[min(after, len(times) - 1)])
        cover = np.full((span[1] - span[0], max(1, end - begin)), 60, np.uint8)
        blend(page, cover, (begin, span[0]), (0, 0, 0))
        if end - begin > 90:
            put_text(page, "no dots", ((begin + end) / 2, span[1] - 10), 8, FAINT, align="middle")


def _mark_events(page: Picture, events: Sequence[tuple[float, str]], high: int) -> None:
    """Texts beside their ticks, each a line lower while the one before is in the way."""
    free = [0.0, 0.0, 0.0]
    for x, text in sorted(events):
        line = next((i for i, edge in enumerate(free) if x >= edge), None)
        box(page, (round(x), high), (1, 12), FAINT)
        if line is None:
            continue
        put_text(page, text, (x + 5, high + 12 + 14 * line), 8, FAINT)
        free[line] = x + drawing.text_width(text, 8) + 16


def _tick(span: float, count: int) -> float:
    """A round step that divides the span into at most about `count` parts."""
    rough = max(span, 1e-6) / count
    power = 10.0 ** np.floor(np.log10(rough))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999))
