"""The report's own arithmetic, on measurements made up by hand."""

from __future__ import annotations

import numpy as np
import pytest

from hypermask.bench.runs import scenario
from hypermask.bench.table import Table
from hypermask.rehearsal import report
from hypermask.rehearsal.journal import Journal
from hypermask_sim.judge import FrameMeasurement


def frame(time_s: float, error_mm: float | None, brightness: float = 1.0) -> FrameMeasurement:
    errors = () if error_mm is None else (("a", error_mm), ("b", error_mm))
    return FrameMeasurement(time_s, errors, np.zeros((len(errors), 3)), brightness, brightness > 0)


def test_registration_is_over_all_dots_and_a_black_show_has_none() -> None:
    figures = report.registration([frame(0, 3.0), frame(1, 4.0), frame(2, None, 0.0)])
    assert figures["rms"] == pytest.approx(np.sqrt(12.5), abs=1e-5)
    assert figures["max"] == 4.0 and figures["black_frames"] == 1
    assert report.registration([frame(0, None, 0.0)])["rms"] is None


def test_an_outage_counts_until_black_and_until_right_and_bright_again() -> None:
    of = scenario("reference-cart", 'faults=[{kind="leds_hidden", from_s=1.0, to_s=2.0}]')
    frames = [frame(t / 100, 1.0) for t in range(120)]
    frames += [frame(1.2, 1.0, 0.5), frame(1.3, None, 0.0), frame(2.01, None, 0.0)]
    frames += [frame(2.04, 30.0), frame(2.06, 1.0, 0.5), frame(2.08, 1.0)]
    (outage,) = report.outages(of, frames)
    assert outage["black_after_ms"] == pytest.approx(300)
    assert outage["right_again_ms"] == pytest.approx(80)


def test_a_picture_that_never_comes_back_is_not_called_right() -> None:
    of = scenario("reference-cart", 'faults=[{kind="leds_hidden", from_s=1.0, to_s=2.0}]')
    (outage,) = report.outages(of, [frame(0.5, 1.0), frame(2.5, 50.0)])
    assert outage["right_again_ms"] is None and outage["black_after_ms"] is None


def test_two_hidden_leds_are_no_outage() -> None:
    of = scenario(
        "reference-cart",
        'faults=[{kind="leds_hidden", from_s=1.0, to_s=2.0, leds=["label", "upper_left"]}]',
    )
    assert report.outages(of, [frame(0.5, 1.0)]) == []


def test_times_count_from_the_scenarios_zero() -> None:
    journal = Journal()
    journal(1001.5, "B", "later")
    journal(1000.5, "A", "sooner")
    journal(0.0, "C", "before the show")
    assert [(e["time_s"], e["code"]) for e in journal.as_data(1000.0)] == [
        (0.0, "C"), (0.5, "A"), (1.5, "B"),
    ]  # fmt: skip
    assert report.shifted([frame(1001.0, 1.0)], 1000.0)[0].time_s == 1.0


def test_a_table_is_markdown_and_data() -> None:
    table = Table("x", "Title", ("what", "mm"), [("a", 1.23456), ("b", None)])
    assert "| a | 1.23 |" in table.markdown() and "| b | - |" in table.markdown()
    assert table.as_data()["rows"] == [{"what": "a", "mm": 1.23456}, {"what": "b", "mm": None}]
