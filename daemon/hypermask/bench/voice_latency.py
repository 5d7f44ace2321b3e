"""How long a sound takes to the mouth on the blackboard, and whether that grows in an hour.

In real time: the voice worker in a process of its own on the simulated microphone, watched from
this process through the shared blackboard. The hour: the ALSA driver on an emulated card whose
quartz is 200 ppm off, in lock-step, so that every sample's true time is known.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress, TaskID

from hypermask.bench.table import Table
from hypermask.errors import HypermaskError
from hypermask.voice.features import HOP
from hypermask.workers.board import Board
from hypermask.workers.realtime import be_realtime, die_with_parent, freeze_garbage
from hypermask.workers.voice import VoiceWorker
from hypermask_drivers.clock import RealClock, VirtualClock
from hypermask_drivers.sound.alsa import AlsaSettings, AlsaSoundIn
from hypermask_sim.devices.sound import SimSoundIn
from hypermask_sim.emulators.alsa import EmulatedAlsa, EmulatedCard
from hypermask_sim.scenario import Scenario
from hypermask_sim.voice_source import SPEECH, spoken
from hypermask_sim.world import World

REALTIME_S = 120.0
HOUR_S, SHORTER_S = 3600.0, 600.0
DRIFT_PPM = 200.0
PERIOD_MS = 4.0  # of the ALSA driver as shipped
PRIORITY = 30  # of the voice worker in a show
_POLL_S = 0.0003
_SEEN = "seen.npy"

_Array = NDArray[np.float64]
_Row = tuple[str | float | int | None, ...]


def voice_latency(progress: bool) -> Table:
    rows: list[_Row] = []
    with Progress(console=Console(stderr=True), disable=not progress) as bar:
        for name, block_ms, card_ms in (
            ("real time, 4 ms periods", PERIOD_MS, 0.0),
            ("real time, reference cart", 8.0, 4.0),
        ):
            task = bar.add_task(name, total=REALTIME_S)
            times, lags = watched(block_ms, card_ms, REALTIME_S, _tick(bar, task))
            rows.append(_row(name, REALTIME_S, times, lags, None))
        for drift_ppm, seconds in ((-DRIFT_PPM, HOUR_S), (DRIFT_PPM, SHORTER_S)):
            name = f"lock-step, quartz {drift_ppm:+.0f} ppm"
            task = bar.add_task(name, total=seconds)
            times, lags, compute = hour(drift_ppm, seconds, _tick(bar, task))
            rows.append(_row(name, seconds, times, lags, compute))
    return Table(
        "voice-latency",
        "From a sound to the mouth on the blackboard",
        (
            "run", "seconds", "start p50 ms", "start p99 ms", "end p50 ms", "end p99 ms", "max ms",
            "creep ms", "a hop p50 ms", "a hop p99 ms",
        ),
        rows,
        (
            "From the middle of the 25 ms that a mouth was made of (12.5 ms before its last "
            "sample) to its record; look-ahead 0, 16 kHz. Start and end: the first and the last "
            "tenth. Creep: what a straight line through all of them rises by. A hop: processor "
            "time for 10 ms of sound, with the driver and the emulated card.",
            "Real time: the worker in a process of its own, seen through the shared blackboard by "
            "another process that looks each 0.3 ms. The reference cart's microphone gives blocks "
            "of 8 ms, 4 ms late.",
            "Lock-step: true times of an emulated card through the ALSA driver, time stamps up to "
            "1 ms late, counter in steps of 1 ms; computing costs no time there.",
        ),
    )  # fmt: skip


def _tick(bar: Progress, task: TaskID) -> Callable[[float], None]:
    return lambda seconds: bar.update(task, completed=seconds)


def _row(name: str, seconds: float, times: _Array, lags: _Array, compute: _Array | None) -> _Row:
    part = max(len(lags) // 10, 1)
    figures: list[float | None] = []
    for some in (lags[:part], lags[-part:]):
        figures += [round(float(q), 3) for q in np.percentile(some * 1e3, [50, 99])]
    creep_s = np.polyfit(times - times[0], lags, 1)[0] * (times[-1] - times[0])
    figures += [round(float(lags.max() * 1e3), 3), round(float(creep_s * 1e3), 4)]
    costs: list[float | None] = [None, None]
    if compute is not None:
        costs = [round(float(q), 3) for q in np.percentile(compute * 1e3, [50, 99])]
    return (name, seconds, *figures, *costs)


def watched(
    block_ms: float, card_ms: float, seconds: float, tick: Callable[[float], None]
) -> tuple[_Array, _Array]:
    """Times and lags (n,) in seconds of every mouth that another process published."""
    context = multiprocessing.get_context("spawn")
    stop, ready = context.Event(), context.Event()
    with tempfile.TemporaryDirectory(prefix="hypermask-") as folder:
        worker = context.Process(
            target=_worker, args=(folder, block_ms, card_ms, ready, stop), daemon=True
        )
        watcher = context.Process(target=_watch, args=(folder, seconds), daemon=True)
        try:
            worker.start()
            if not ready.wait(60):
                raise _silent()
            watcher.start()
            begin_s = time.monotonic()
            while watcher.is_alive() and time.monotonic() < begin_s + seconds + 60:
                watcher.join(1.0)
                tick(min(time.monotonic() - begin_s, seconds))
            seen = Path(folder) / _SEEN
            if not seen.is_file():
                raise _silent()
            times, lags = np.load(seen)
            return times, lags
        finally:
            stop.set()
            for process in (worker, watcher):
                if process.pid is not None:
                    process.join(2)
                    process.kill()


def _silent() -> HypermaskError:
    return HypermaskError("WRK-START", "the voice process did not start", "Look at its messages.")


def _watch(folder: str, seconds: float) -> None:
    """Leaves (2, n) times and lags in the folder. Above the worker, for it may not be late."""
    die_with_parent()
    board = Board.shared(Path(folder))
    times, lags = [], []
    be_realtime(PRIORITY + 1)
    begin_s, last_s = time.monotonic() + 1.0, 0.0  # a second for it to come to rest
    while (now_s := time.monotonic()) < begin_s + seconds:
        record = board.mouth.latest()
        if record is not None and float(record["time_s"]) > last_s:
            last_s = float(record["time_s"])
            if now_s > begin_s:
                times.append(now_s - begin_s)
                lags.append(now_s - last_s)
        time.sleep(_POLL_S)
    if times:
        np.save(Path(folder) / _SEEN, np.array([times, lags]))


def _worker(folder: str, block_ms: float, card_ms: float, ready: Any, stop: Any) -> None:
    die_with_parent()
    clock = RealClock()
    scenario = Scenario.model_validate(
        {
            "duration_s": 600.0,
            "performer": {"voice": "speech", "voice_pause_s": 0.5},
            "microphone": {"block_ms": block_ms},
            "latency": {"voice_ms": card_ms},
        }
    )
    world = World(scenario, origin_s=clock.now())
    sound = SimSoundIn(world, clock)
    worker = VoiceWorker(sound, Board.shared(Path(folder)), clock, lambda *said: None)
    freeze_garbage()
    be_realtime(PRIORITY)
    ready.set()
    while not stop.is_set():
        if not worker.step(0.1):
            clock.sleep_until(clock.now() + 0.002)


def hour(
    drift_ppm: float, seconds: float, tick: Callable[[float], None]
) -> tuple[_Array, _Array, _Array]:
    """Times, lags against the truth and computing times (n,) in seconds, one for each hop."""
    voice = spoken(SPEECH, 16_000).repeated(0.5, 1.0).samples
    if not len(voice):  # no synthesiser: noise is as much work
        voice = np.random.default_rng(1).normal(0, 0.05, 16_000).astype(np.float32)
    first: list[int] = []

    def signal(frames: NDArray[np.int64]) -> _Array:
        if not first and len(frames):
            first.append(int(frames[0]))
        return np.asarray(voice[frames % len(voice)], float)

    clock = VirtualClock(1000.0)
    card = EmulatedCard(
        clock, rate_hz=16_000, signal=signal, drift_ppm=drift_ppm, step_s=0.001, jitter_s=0.001
    )
    settings = AlsaSettings(device="hw:CARD=hypermask_mic", rate_hz=16_000, period_ms=PERIOD_MS)
    board = Board.local()
    worker = VoiceWorker(
        AlsaSoundIn(settings, clock, EmulatedAlsa([card])), board, clock, lambda *said: None
    )
    times, lags, compute = [], [], []
    spent_s, last_s, hops, begin_s = 0.0, 0.0, 0, clock.now()
    while clock.now() < begin_s + seconds:
        clock.sleep_until(clock.now() + PERIOD_MS * 1e-3 / 2)
        began_s = time.thread_time()
        heard = worker.step()
        spent_s += time.thread_time() - began_s
        if not heard:
            continue
        record = board.mouth.latest()
        if record is None or float(record["time_s"]) <= last_s:
            continue
        last_s = float(record["time_s"])
        heard_s = card.time_of(first[0] + hops * HOP + 199.5)
        hops += 1
        times.append(clock.now() - begin_s)
        lags.append(clock.now() - heard_s)
        compute.append(spent_s)
        spent_s = 0.0
        if hops % 1000 == 0:
            tick(times[-1])
    return np.array(times), np.array(lags), np.array(compute)
