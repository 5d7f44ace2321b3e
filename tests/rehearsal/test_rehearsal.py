"""A whole show in lock-step, judged from its pixels, its files and its sounds."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.bench.runs import calibration, played, scenario
from hypermask.rehearsal.run import play
from hypermask_sim.judge import Judge
from hypermask_sim.scenario import Scenario


@pytest.fixture(scope="module")
def clicked() -> Any:
    """The program's own click calibration of the reference cart."""
    return calibration(scenario("reference-cart"))


def report(of: Scenario, calibrated: Any = None, out: Path | None = None) -> dict[str, Any]:
    return play(of, out, pictures=False, quiet=True, calibration=calibrated)


def test_a_still_mask_is_hit_within_a_millimetre_after_click_calibration(clicked: Any) -> None:
    cart = scenario("reference-cart", "duration_s=0.5")
    for distance in (1.2, 2.4):
        result = report(cart.still(distance), clicked)
        assert result["registration_mm"]["rms"] <= 1.0
        assert result["tracking"]["visible_fraction"] == 1.0
        assert result["tracking"]["wrong_labels"] == 0


def test_prediction_makes_the_difference_in_motion(clicked: Any) -> None:
    rms = {}
    for mode in ("default", "off"):
        of = scenario(
            "reference-cart",
            "performer.motion=dance",
            "duration_s=3",
            f"tracking.prediction={mode}",
        )
        rms[mode] = report(of, clicked)["registration_mm"]["rms"]
    assert rms["default"] <= 0.38 * rms["off"]


def test_the_same_scenario_twice_gives_the_same_report(tmp_path: Path) -> None:
    for name in ("first", "second"):
        of = scenario(
            "reference-cart", "performer.motion=sway", "performer.voice=none", "duration_s=1"
        )
        report(of, out=tmp_path / name)
    first, second = ((tmp_path / name / "report.json").read_bytes() for name in ("first", "second"))
    assert first == second


def test_another_seed_gives_another_report() -> None:
    reports = [
        report(scenario("reference-cart", "duration_s=0.3", f"seed={seed}"))["registration_mm"]
        for seed in (1, 2)
    ]
    assert reports[0] != reports[1]


def test_the_lead_is_measured_and_a_slower_projector_lengthens_it(clicked: Any) -> None:
    leads = [
        report(scenario("reference-cart", "duration_s=0.5", f"projector.light_ms={ms}"), clicked)[
            "lead_ms"
        ]["p50"]
        for ms in (17, 27)
    ]
    assert leads[1] - leads[0] == pytest.approx(10.0, abs=0.5)


def test_a_camera_whose_phase_cannot_be_moved_waits_longer(clicked: Any) -> None:
    leads = [
        report(
            scenario(
                "reference-cart", "duration_s=1", "camera.phase_ms=4", f"camera.shiftable={on}"
            ),
            clicked,
        )["lead_ms"]["p50"]
        for on in ("true", "false")
    ]
    assert leads[0] < leads[1] - 1.0


def test_all_leds_hidden_fades_to_black_and_back(clicked: Any) -> None:
    of = scenario(
        "reference-cart",
        "performer.motion=sway",
        "duration_s=3",
        'faults=[{kind="leds_hidden", from_s=1.0, to_s=2.0}]',
    )
    outage = report(of, clicked)["outages"][0]
    assert outage["black_after_ms"] <= 400
    assert outage["right_again_ms"] <= 100


def test_two_leds_hidden_do_not_move_the_picture(clicked: Any) -> None:
    fault = 'faults=[{kind="leds_hidden", from_s=1.0, to_s=1.5, leds=["upper_left", "label"]}]'
    base = ["performer.motion=sway", "duration_s=2"]
    clean, hidden = (
        [
            frame
            for frame in played(scenario("reference-cart", *base, *extra), clicked).measured
            if 1.05 < frame.time_s < 1.5
        ]
        for extra in ([], [fault])
    )
    assert len(clean) == len(hidden)
    rms = [Judge.summary(frames).rms for frames in (clean, hidden)]
    assert rms[1] <= 2 * rms[0] + 0.3


def test_a_lost_camera_is_told_once_and_comes_back(clicked: Any) -> None:
    of = scenario(
        "reference-cart", "duration_s=4", 'faults=[{kind="camera_lost", from_s=1.0, to_s=2.0}]'
    )
    result = report(of, clicked)
    codes = [event["code"] for event in result["events"]]
    assert codes.count("CAM-LOST") == 1
    assert codes.count("CAMERA-BACK") == 1
    outage = result["outages"][0]
    assert outage["black_after_ms"] <= 400
    assert outage["right_again_ms"] <= 1000 + 100  # retried each second


def test_an_unplugged_keypad_and_a_lost_microphone_do_not_stop_the_show(clicked: Any) -> None:
    of = scenario(
        "reference-cart",
        "duration_s=3",
        'performer.keys=[[0.2, "5"], [2.6, "6"]]',
        'faults=[{kind="keypad_unplugged", from_s=0.5, to_s=1.0}, '
        '{kind="sound_lost", from_s=0.5, to_s=1.0}]',
    )
    result = report(of, clicked)
    told = [event["text"] for event in result["events"] if event["code"] == "CUE"]
    assert told == ["Key 5: happiness", "Key 6: anger"]
    assert result["frames"] == 180


def test_a_lost_projector_comes_back_with_its_picture(clicked: Any) -> None:
    of = scenario(
        "reference-cart", "duration_s=3", 'faults=[{kind="projector_lost", from_s=1.0, to_s=1.5}]'
    )
    result = report(of, clicked)
    codes = [event["code"] for event in result["events"]]
    assert codes.count("PRJ-LOST") == 1 and codes.count("PROJECTOR-BACK") == 1
    late = [
        rms
        for time_s, rms in zip(result["series"]["light_s"], result["series"]["rms_mm"], strict=True)
        if time_s > 2.3
    ]
    assert late and all(rms is not None and rms < 2.0 for rms in late)


def test_the_papers_map_is_right_at_its_distance_and_off_it_by_what_it_reports() -> None:
    for kind in ("affine", "projective"):
        cart = scenario(f"paper-{kind}", "duration_s=0.4")
        made = calibration(cart)
        there = report(cart.still(1.8), made)
        assert there["registration_mm"]["rms"] <= 3.0
        away = report(cart.still(2.3), made)["registration_mm"]["rms"]
        assert away == pytest.approx(made.expected_error_m(2.3) * 1e3, rel=0.25)
        assert not made.band_m[0] <= 2.3 <= made.band_m[1]


def test_a_mouth_follows_the_voice_and_rests_in_silence() -> None:
    if shutil.which("espeak-ng") is None:
        pytest.skip("espeak-ng is not installed")
    of = scenario(
        "reference-cart",
        "performer.voice=speech",
        "performer.voice_start_s=0.5",
        "duration_s=3",
        "calibration.method=exact",
    )
    mouth = report(of)["mouth"]
    opening = np.linalg.norm(np.array(mouth["parameters"]), axis=1)
    times = np.array(mouth["times_s"])
    assert opening[times < 0.45].max() < 0.05
    assert opening[times > 0.8].max() > 0.4


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="ffmpeg is not installed")
def test_a_rehearsal_leaves_a_film_with_sound_a_sheet_and_a_report(tmp_path: Path) -> None:
    of = scenario(
        "reference-cart",
        "character=mean",
        "performer.motion=sway",
        "performer.voice=speech",
        "duration_s=1",
        'performer.keys=[[0.1, "5"]]',
        "calibration.method=exact",
    )
    play(of, tmp_path, quiet=True)
    kept = json.loads((tmp_path / "report.json").read_text())
    for key in ("frames", "registration_mm", "tracking", "lead_ms", "compute_ms", "missed_flips",
                "mouth", "events"):  # fmt: skip
        assert key in kept
    assert set(kept["registration_mm"]) >= {"median", "rms", "p95", "max"}
    assert kept["registration_mm"]["rms"] < 5
    sheet = cv2.imread(str(tmp_path / "contact-sheet.png"))
    assert sheet is not None and sheet.shape[1] >= 1200
    probe = subprocess.run(
        ["ffprobe", "-v", "error", "-show_streams", "-of", "json", str(tmp_path / "show.mp4")],
        capture_output=True,
        check=True,
    )
    streams = {item["codec_type"]: item for item in json.loads(probe.stdout)["streams"]}
    assert set(streams) == {"video", "audio"}
    assert float(streams["video"]["duration"]) == pytest.approx(1.0, abs=0.15)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_every_shipped_scenario_is_valid() -> None:
    names = sorted(path.stem for path in (paths.configs() / "scenarios").glob("*.toml"))
    assert {"reference-cart", "fast-cart", "demo"} <= set(names)
    for name in names:
        scenario(name)
