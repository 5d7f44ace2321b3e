"""The process beside a playing show in which a voice is learnt."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from voice_sounds import needs_data, said

from hypermask.voice import recurrent, speaker
from hypermask.voice.calibrate import check
from hypermask.voice.takes import ASKED
from hypermask.workers.lesson_teacher import Checked, Learnt, Refused, Started, TeacherProcess
from hypermask_drivers.clock import RealClock

pytestmark = needs_data


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path))
    return tmp_path


def test_the_process_teaches_as_the_worker_itself_does() -> None:
    """In a process of its own, which gives way to others and ends when it is closed."""
    process = TeacherProcess(None)
    try:
        assert reply_of(process) == Started()
        process.ask("take", "a", said("m10", "i").astype(np.float32))
        assert isinstance(reply_of(process), Checked)
        process.ask("learn", "anna")
        refused = reply_of(process)
        assert isinstance(refused, Refused) and refused.code == "VOICE-TAKE"
        network = recurrent.shipped()
        takes = {asked: np.pad(said("m10", asked), 4800) for asked in ASKED}
        for asked, sound in takes.items():
            process.ask("take", asked, sound.astype(np.float32))
            checked = reply_of(process)
            assert checked == Checked(asked, check(asked, sound, network).problem)
        process.ask("learn", "anna")
        learnt = reply_of(process)
        assert isinstance(learnt, Learnt) and learnt.kept
        found, _ = speaker.load_current()
        assert found is not None
        assert np.array_equal(found.correction, learnt.result.speaker.correction)
    finally:
        process.close()
    assert process._process.poll() is not None


def test_a_process_that_dies_is_seen() -> None:
    process = TeacherProcess(None)
    assert reply_of(process) == Started()
    process._process.kill()
    assert isinstance(reply_of(process), Refused)
    process.close()


def reply_of(process: TeacherProcess) -> object:
    clock = RealClock()
    while (reply := process.reply()) is None:
        clock.sleep_until(clock.now() + 0.01)
    return reply
