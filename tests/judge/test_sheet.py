"""The contact sheet holds what it was given, where the eye looks for it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask_sim.drawing import plain, put_text, text_width
from hypermask_sim.sheet import LED, WIDTH, KeyFigure, Moment, camera_view, contact_sheet

RED, GREEN = (200, 30, 40), (20, 180, 60)


def moment(time_s: float) -> Moment:
    camera = np.full((800, 1280), 8, np.uint8)
    camera[400, 640] = 250
    return Moment(
        time_s,
        "happiness, 30°",
        np.full((720, 960, 3), RED, np.uint8),
        np.full((720, 1280, 3), GREEN, np.uint8),
        camera,
        np.array([[640.0, 400.0], [np.nan, np.nan]]),
    )


def close_to(page: NDArray[np.uint8], colour: tuple[int, int, int]) -> int:
    return int((np.abs(page.astype(int) - colour).max(axis=2) <= 4).sum())


def test_every_moment_shows_its_three_pictures(tmp_path: Path) -> None:
    one = contact_sheet("Title", "sub", [], [moment(1)])
    four = contact_sheet("Title", "sub", [], [moment(t) for t in range(4)])
    assert one.shape[1] == WIDTH and one.shape[0] < four.shape[0]
    for colour in (RED, GREEN):
        assert close_to(one, colour) > 10_000
        assert close_to(four, colour) == pytest.approx(4 * close_to(one, colour), rel=0.01)


def test_the_page_is_written_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "new/contact-sheet.png"
    errors = [(t / 60, 1.5 if t < 90 else float("nan")) for t in range(120)]
    figures = [KeyFigure("rms", "1.5 mm", "limit 2.5", True), KeyFigure("flips", "7", good=False)]
    page = contact_sheet("T", "s", figures, [moment(0.5)], errors, [(1.5, "lost")], path)
    stored = cv2.imread(str(path))
    assert stored is not None
    np.testing.assert_array_equal(cv2.cvtColor(stored, cv2.COLOR_BGR2RGB), page)
    assert [p.name for p in path.parent.iterdir()] == ["contact-sheet.png"]


def test_the_curve_is_at_the_height_of_the_error() -> None:
    def curve_row(error: float) -> float:
        errors = [(t / 60, error if t else 4.0) for t in range(120)]
        page = contact_sheet("T", "s", [], [], errors).astype(int)
        green = (page[:, WIDTH // 2, 1] - page[:, WIDTH // 2, 0]) > 40
        return float(np.flatnonzero(green).mean())

    one, two, three = curve_row(1.0), curve_row(2.0), curve_row(3.0)
    assert one > two > three
    assert one - two == pytest.approx(two - three, abs=1.5)


def test_sheets_without_any_error_or_moment_are_drawn() -> None:
    nothing = [(0.0, float("nan")), (1.0, float("nan"))]
    assert contact_sheet("T", "s", [], [], nothing).shape[1] == WIDTH
    assert contact_sheet("", "", [], []).shape[1] == WIDTH
    assert contact_sheet("T", "s", [], [], [(0.0, 0.0)]).shape[1] == WIDTH


def test_a_single_bright_pixel_of_the_camera_stays_visible_and_is_circled() -> None:
    frame = np.zeros((800, 1280), np.uint8)
    frame[250, 333] = 255
    view = camera_view(frame, (256, 160), np.array([[333.0, 250.0]]))
    row, column = np.unravel_index(np.argmax(view[..., 0]), view.shape[:2])
    assert (column * 5 + 2, row * 5 + 2) == pytest.approx((333, 250), abs=5)
    ring = np.argwhere(np.abs(view.astype(int) - LED).max(axis=2) < 60)
    assert ring.mean(axis=0) == pytest.approx(
        [(250 + 0.5) / 5 - 0.5, (333 + 0.5) / 5 - 0.5], abs=0.5
    )


def test_text_is_smooth_and_where_it_is_put() -> None:
    page = np.zeros((60, 400, 3), np.uint8)
    put_text(page, "Hypermask 1.4 mm", (20, 40), 16, (255, 255, 255))
    rows, columns = np.nonzero(page[..., 0] > 100)
    assert rows.min() == pytest.approx(24, abs=2)
    assert columns.min() == pytest.approx(20, abs=3)
    assert columns.max() == pytest.approx(20 + text_width("Hypermask 1.4 mm", 16), abs=4)
    assert np.unique(page[..., 0]).size > 30
    put_text(page, "cut at the edge", (390, 5), 16, (255, 255, 255))


def test_letters_that_cannot_be_drawn_are_replaced() -> None:
    assert plain("30° ± 2 – Führung") == "30 deg +- 2 - Fuhrung"
