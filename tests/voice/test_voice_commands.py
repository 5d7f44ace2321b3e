"""`hypermask voice`: scores and pictures from the command line, faults in one line."""

from __future__ import annotations

import json

import cv2
import numpy as np
from typer.testing import CliRunner
from voice_sounds import DATA, needs_data

from hypermask.cli.voice import app

SPEECH = DATA / "speech" / "austen-0880.wav"
PHONES = DATA / "speech" / "austen-0880.phone.json"


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@needs_data
def test_align_prints_one_object_and_our_mode_beats_the_papers():
    accuracy = {}
    for model in ("default", "paper"):
        done = run("align", SPEECH, PHONES, "--model", model, "--json")
        assert done.exit_code == 0, done.output
        result = json.loads(done.stdout)
        accuracy[model] = result["frame_accuracy"]
        assert {"macro_f1", "closure_recall", "closure_delay_ms", "false_opening", "jitter"} <= set(
            result
        )
    assert accuracy["default"] > accuracy["paper"] + 0.15


@needs_data
def test_align_in_words():
    done = run("align", SPEECH, PHONES, "--lookahead", 30)
    assert "frame accuracy" in done.output
    assert "closure delay ms" in done.output


@needs_data
def test_show_draws_a_picture(tmp_path):
    done = run("show", SPEECH, "--phones", PHONES, "--out", tmp_path / "v.png")
    assert done.exit_code == 0, done.output
    picture = cv2.imread(str(tmp_path / "v.png"))
    assert picture.shape[1] > 900
    red = np.all(np.abs(picture.astype(int) - (40, 40, 200)) < 40, axis=2)
    assert red.any(axis=0).sum() > 500  # the opening is drawn all along


def test_faults_are_named(tmp_path):
    (tmp_path / "none.json").write_text("{}")
    assert "VOICE-" in run("align", tmp_path / "no.wav", tmp_path / "none.json").output
    assert "VOICE-" in run("show", tmp_path / "no.wav", "--out", tmp_path / "v.png").output
    assert "VOICE-MODEL" in run("eval", tmp_path / "no.csv", "--model", "best").output
    if SPEECH.exists():
        assert "VOICE-LOOKAHEAD" in run("show", SPEECH, "--lookahead", 15).output
