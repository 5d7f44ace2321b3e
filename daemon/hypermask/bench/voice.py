"""The voice: our two modes beside MFCC templates and a flapping mouth, in silence and in noise.

Connected speech: read sentences of ../shared/data/speech, and sentences that were never trained on,
by voices that were never trained on. Every method that needs a speaker's calibration gets it from
other sentences of the same voice. Vowels: the recordings of ../shared/data/vowels.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from hypermask import paths
from hypermask.bench.table import Table
from hypermask.bench.voices import PAUSES, Spoken, Voice, paused, voices
from hypermask.voice import noise, paper_base, recurrent, reference
from hypermask.voice.align import Track, follow, report
from hypermask.voice.corpus import timeline
from hypermask.voice.evaluate import evaluate
from hypermask.voice.features import HOP, HOP_S, WINDOW, LogMel, framed
from hypermask.voice.hearing import Ear, PaperEar, RecurrentEar
from hypermask.voice.lpc import FRAME, RATE_HZ, cepstra
from hypermask.voice.settings import VoiceSettings
from hypermask.voice.shapes import SHAPE_NAMES
from hypermask.voice.synthesis import Phone
from hypermask.voice.visemes import VISEME_OF_CLASS

METHODS = ("default", "default, 30 ms", "paper", "MFCC templates", "flapping")
RATIOS_DB = (None, 20.0, 10.0, 0.0)
_COLOURS = ("tab:green", "tab:olive", "tab:orange", "tab:blue", "tab:gray")
_UNHEARD_FIGURES = Path(recurrent.__file__).parent / "data" / "unheard.json"

Row = tuple[str | float | int | None, ...]


def voice(progress: bool) -> Table:
    """All of it; raises `DataError` BENCH-DATA without recordings."""
    with Progress(console=Console(stderr=True), disable=not progress) as bar:
        found, absent = voices(bar)
        resting = paused(found)
        sets = list(dict.fromkeys(one.set_name for one in found))
        rows: list[Row] = []
        pauses: list[Row] = []
        curves: dict[str, list[float]] = {name: [] for name in METHODS}
        task = bar.add_task("following", total=len(METHODS) * len(RATIOS_DB))
        for method in METHODS:
            for ratio in RATIOS_DB:
                heard = _followed(found, method, ratio)
                if ratio is None:
                    rows += [_row(name, method, tracks) for name, tracks in heard.items()]
                    pauses += [_pause_row(method, _followed(resting, method, None)[PAUSES])]
                every = report([one for tracks in heard.values() for one in tracks])
                curves[method].append(every["frame_accuracy"])
                bar.advance(task)
        vowels = [*_vowels(bar), *_unheard()]
    rows.sort(key=lambda row: sets.index(str(row[0])))
    rows += pauses
    rows += [
        _noise_row(ratio, [curves[m][k] for m in METHODS]) for k, ratio in enumerate(RATIOS_DB)
    ]
    return Table(
        "voice",
        "Voice to mouth: connected speech by voices and sentences never trained on",
        ("speech", "method", "viseme frames", "macro F1", "closures seen", "closure delay ms",
         "open in pauses", "jitter"),
        rows,
        (*vowels, *_notes(absent), f"Default: {_hop_ms():.2f} ms of computing for each 10 ms hop."),
        plot=_plot(curves),
        data={"snr_sweep": {"snr_db": list(RATIOS_DB), **curves}},
    )  # fmt: skip


# --- who listens


def _followed(
    spoken: Sequence[Voice], method: str, snr_db: float | None
) -> dict[str, list[tuple[Track, list[Phone]]]]:
    rng = np.random.default_rng(0)
    settings = VoiceSettings(mode="paper" if method == "paper" else "default")
    heard: dict[str, list[tuple[Track, list[Phone]]]] = {}
    for one in spoken:
        make = _ear(method, one.calibration)
        for line in one.scored:
            sound = _noisy(line.samples, snr_db, rng)
            track, _ = follow(sound, RATE_HZ, settings, ear=make())
            heard.setdefault(one.set_name, []).append((track, line.phones))
    return heard


def _noisy(sound: NDArray[np.float64], snr_db: float | None, rng: np.random.Generator) -> Any:
    if snr_db is None:
        return sound
    power = np.sort(np.mean(framed(sound) ** 2, axis=1))
    level = float(np.sqrt(np.mean(power[len(power) // 2 :])))
    return noise.add(sound, noise.coloured(rng, len(sound), 1.0), snr_db, level)


def _ear(method: str, calibration: Sequence[Spoken]) -> Callable[[], Ear]:
    if method.startswith("default"):
        network = recurrent.shipped()
        return lambda: RecurrentEar(network, 3 if "30" in method else 0)
    if method == "flapping":
        return reference.LevelEar
    if method == "paper":
        base = paper_base.shipped()
        vowels = _by_vowel(calibration, FRAME, cepstra)
        net = base.network(base.choose(vowels))
        return lambda: PaperEar(net)
    spectrum = LogMel()
    mel = _by_vowel(calibration, WINDOW, lambda f: reference.mfcc(spectrum(f).bands_db))
    templates = reference.learn(mel)
    return lambda: reference.TemplateEar(templates)


def _by_vowel(
    calibration: Sequence[Spoken],
    window: int,
    features: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> dict[str, NDArray[np.float64]]:
    """Features of the windows in the middle of each of the five vowels."""
    found: dict[str, list[NDArray[np.float64]]] = {}
    for spoken in calibration:
        targets = timeline(spoken.phones, len(spoken.samples) // HOP)
        viseme = np.where(targets.sum(axis=1) > 0, VISEME_OF_CLASS[targets.argmax(axis=1)], 0)
        for k in range(2, len(viseme) - 2):
            at = k * HOP + HOP // 2 - window // 2
            inside = at >= 0 and at + window <= len(spoken.samples)
            if inside and 1 <= viseme[k] <= 5 and np.all(viseme[k - 2 : k + 3] == viseme[k]):
                name = SHAPE_NAMES[viseme[k]]
                found.setdefault(name, []).append(spoken.samples[at : at + window])
    return {name: features(np.array(windows)) for name, windows in found.items()}


# --- what comes of it


def _row(name: str, method: str, heard: list[tuple[Track, list[Phone]]]) -> Row:
    scores = report(heard)
    delay = scores["closure_delay_ms"]
    return (
        name, method, _percent(scores["frame_accuracy"]), round(scores["macro_f1"], 3),
        _percent(scores["closure_recall"]), None if delay is None else round(delay),
        _percent(scores["false_opening"]), round(scores["jitter"], 4),
    )  # fmt: skip


def _pause_row(method: str, heard: list[tuple[Track, list[Phone]]]) -> Row:
    """Only how often the mouth is open where nobody speaks: the sentences are those of above."""
    scores = report(heard)
    name = f"{PAUSES}, {scores['pause_s']:.0f} s"
    return (name, method, None, None, None, None, _percent(scores["false_opening"]), None)


def _percent(value: float | None) -> str | None:
    return None if value is None else f"{value:.1%}"


def _noise_row(ratio: float | None, accuracy: list[float]) -> Row:
    name = "all, as recorded" if ratio is None else f"all, pink noise {ratio:.0f} dB"
    listed = ", ".join(f"{m} {a:.1%}" for m, a in zip(METHODS, accuracy, strict=True))
    return (name, "viseme frames: " + listed, None, None, None, None, None, None)


def _vowels(bar: Progress) -> list[str]:
    table = paths.share().parent / "shared" / "data" / "vowels" / "vowels.csv"
    if not table.is_file():
        return ["The recordings of vowels are absent."]
    found = {}
    cases = [(m, r) for m in ("default", "paper") for r in (None, 10.0)]
    for model, ratio in bar.track(cases, description="vowels"):
        found[model, ratio] = evaluate(table, model, ratio)["frame_accuracy"]
    return [
        "Five vowels, 100 speakers, nucleus frames: paper, best of the others' networks "
        f"{found['paper', None]:.1%} (10 dB pink noise {found['paper', 10.0]:.1%}). "
        f"The shipped default network {found['default', None]:.1%} "
        f"({found['default', 10.0]:.1%}), but it was trained on these speakers."
    ]


def _unheard() -> list[str]:
    """Measured when the network was trained: it takes an hour to do again."""
    if not _UNHEARD_FIGURES.is_file():
        return []
    lines = []
    for run in json.loads(_UNHEARD_FIGURES.read_text("utf-8"))["runs"]:
        groups = ", ".join(f"{k} {v:.1%}" for k, v in run["groups"].items())
        lines.append(
            f"Trained without {run['speakers']} speakers (seed {run['seed']}) and asked about "
            f"them: {run['frame_accuracy']:.1%} ({groups}), with all frames to the edges of the "
            f"nucleus {run['to_the_edges']:.1%}; 10 dB pink noise "
            f"{run['pink_10_db']:.1%}; calibrated {run['calibrated']:.1%}."
        )
    return lines


def _notes(absent: list[str]) -> list[str]:
    notes = [
        "Nine visemes; a closure is seen when the lips meet while /p b m/ is spoken or up to 60 ms "
        "after; the delay counts from the closure in the sound to when the parameters exist.",
        "Targets: default above paper and templates by 15 points, closures >= 90 % within 40 ms, "
        "open in pauses of 300 ms and more <= 2 %.",
    ]
    return notes + [f"Not installed here and left out: {', '.join(absent)}."] * bool(absent)


def _hop_ms() -> float:
    """Milliseconds of computing for a hop of the default mode, median."""
    ear = RecurrentEar(recurrent.shipped())
    sound, times = np.random.default_rng(0).normal(0, 0.1, WINDOW), []
    for _ in range(500):
        began = time.perf_counter()
        ear.hear(sound)
        times.append(time.perf_counter() - began)
    return float(np.median(times)) * HOP_S / 0.01 * 1e3


def _plot(curves: dict[str, list[float]]) -> bytes:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    names = ["as recorded" if r is None else f"{r:.0f} dB" for r in RATIOS_DB]
    for (method, values), colour in zip(curves.items(), _COLOURS, strict=True):
        axes.plot(names, [100 * v for v in values], "o-", label=method, color=colour)
    axes.set(xlabel="speech to pink noise", ylabel="viseme frames right, %", ylim=(0, 100))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100, metadata={"Software": None})
    return buffer.getvalue()
