"""The voice's process: sound in, the mouth's parameters out."""

from __future__ import annotations

from hypermask.services.loop import Loop, Quiet
from hypermask.services.rig import Rig
from hypermask.workers.voice import VoiceWorker, speaker_in_use
from hypermask_drivers.device import DeviceState
from hypermask_drivers.sound import SoundIn

WAIT_S = 0.1
IDLE_S = 0.02


_KEPT = 100
"""Frames: a voice that is followed for hours keeps no more of itself."""


def build(rig: Rig) -> Loop:
    sound = rig.device("sound")
    if sound is None:
        return Quiet("no microphone in this machine")
    assert isinstance(sound, SoundIn)
    return VoiceLoop(rig, sound)


class VoiceLoop:
    """calibrated: whether this machine's speaker is known to it. kept: frames for a report."""

    def __init__(
        self, rig: Rig, sound: SoundIn, calibrated: bool = True, kept: int = _KEPT
    ) -> None:
        self._rig, self._clock, self._health = rig, rig.clock, rig.health
        self._sound = sound
        who = speaker_in_use(rig.report, rig.clock.now()) if calibrated else None
        self.worker = VoiceWorker(
            sound, rig.board, rig.clock, rig.report, rig.machine.voice, who, kept
        )
        self._tries = 0

    def begin(self) -> None:
        """Nothing."""

    def turn(self) -> bool:
        worker = self.worker
        took = worker.step(WAIT_S)
        ready = self._sound.state is DeviceState.READY
        self._health.device(ready)
        if took:
            history = worker.history
            age_s = self._clock.now() - history[-1].time_s if history else None
            self._health.worked(age_s)
            return True
        if not ready:
            self._clock.sleep_until(self._clock.now() + IDLE_S)
        tried, self._tries = worker.sound.tries != self._tries, worker.sound.tries
        return tried

    def status(self) -> str:
        ready = self._sound.state is DeviceState.READY
        return "follows the voice" if ready else "waits for the microphone"

    def stop(self) -> None:
        self.worker.close()
        self._sound.close()
