"""A lesson by command: with the microphone of the show that runs, or with the machine's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypermask.errors import DataError
from hypermask.workers.board import Board
from hypermask.workers.lesson import VoiceLesson
from hypermask.workers.running import running_board
from hypermask.workers.voice import VoiceWorker, speaker_in_use
from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.registry import driver_class
from hypermask_drivers.settings import parse
from hypermask_drivers.sound import SoundIn
from hypermask_drivers.sound.alsa import AlsaSettings

_STEP_S = 0.02


def teach(who: str, sound: str, device: str, say: Callable[[str], None]) -> dict[str, Any]:
    """Learn a voice; what came of it, as plain data.

    sound, device: driver and name of the microphone where no show runs. Raises `HypermaskError`
    where nothing was learnt: VOICE-LESSON, VOICE-DEAF, VOICE-TEACHER, DISK-WRITE, the code of a
    take that went wrong again and again; SND-ABSENT and its like; DRV-NAME, CFG-VALUE.
    """
    clock = RealClock()
    try:
        board = Board.reading(running_board(), but="lesson")
    except DataError as error:
        if error.code != "SHOW-NONE":
            raise
        return _alone(who, open_microphone(sound, device, clock), clock, say)
    lesson = VoiceLesson(board, who, say, by_keys=False)
    return _led(lesson, clock, lambda: clock.sleep_until(clock.now() + _STEP_S))


def open_microphone(sound: str, device: str, clock: Clock) -> SoundIn:
    """Opened once here, so that what is wrong with it is said at once."""
    kind = driver_class("sound", sound)
    if sound == "alsa":
        settings = parse(AlsaSettings, {"device": device}, "--device")
        microphone = kind(settings, clock)  # type: ignore[call-arg]
    else:
        from hypermask_sim.scenario import Scenario  # a cart to try things on
        from hypermask_sim.world import World

        voice = {"performer": {"voice": device if Path(device).is_file() else "none"}}
        world = World(Scenario.model_validate(voice), origin_s=clock.now())
        microphone = kind(world, clock)  # type: ignore[call-arg]
    assert isinstance(microphone, SoundIn)
    microphone.open()
    return microphone


def _alone(
    who: str, microphone: SoundIn, clock: Clock, say: Callable[[str], None]
) -> dict[str, Any]:
    """This process is the voice worker too."""

    def report(time_s: float, code: str, text: str) -> None:
        say(text)

    board = Board.local()
    worker = VoiceWorker(microphone, board, clock, report, speaker=speaker_in_use(report))
    lesson = VoiceLesson(board, who, say, by_keys=False)

    def listen() -> None:
        if not worker.step(_STEP_S):
            clock.sleep_until(clock.now() + 0.002)

    try:
        return _led(lesson, clock, listen)
    finally:
        worker.close()
        microphone.close()


def _led(lesson: VoiceLesson, clock: Clock, pause: Callable[[], None]) -> dict[str, Any]:
    lesson.begin(clock.now())
    try:
        while lesson.step(clock.now()):
            pause()
    except BaseException:
        lesson.press("numlock", clock.now())
        raise
    if lesson.failure is not None:
        raise lesson.failure
    assert lesson.result is not None
    bad = [{"asked": one.asked, "code": one.problem} for one in lesson.tries if one.problem]
    return {**lesson.result, "repeated": bad}
