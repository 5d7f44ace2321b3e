"""`hypermask voice`: how well speech becomes a mouth, and what an actor's voice is like."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from hypermask.cli.output import JsonOption, console, print_json, reports_errors
from hypermask.errors import DataError, UsageError

app = typer.Typer(help="Measure the voice model, calibrate a voice.", no_args_is_help=True)

_Wav = Annotated[Path, typer.Argument(metavar="WAV", help="A recording of speech.")]
_Model = Annotated[str, typer.Option(help="default or paper")]
_Lookahead = Annotated[int, typer.Option(metavar="MS", help="The mouth waits: 0, 10, 20 or 30 ms.")]


@app.command("eval")
@reports_errors
def evaluate(
    table: Annotated[
        Path, typer.Argument(metavar="CSV", help="Recordings with vowel, start_ms and end_ms.")
    ],
    model: _Model = "default",
    pink_db: Annotated[
        float | None, typer.Option(metavar="DB", help="Add pink noise at this ratio.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Frame accuracy on recorded vowels; paths in the CSV are relative to it."""
    from hypermask.voice.evaluate import evaluate as run

    result = run(table, model, pink_db)
    if as_json:
        print_json(result)
        return
    console.print(f"frame accuracy  {result['frame_accuracy']:.1%}")
    for group, accuracy in result["groups"].items():
        console.print(f"  {group:13} {accuracy:.1%}")


@app.command()
@reports_errors
def align(
    wav: _Wav,
    phones: Annotated[Path, typer.Argument(metavar="PHONES.json", help="Its phone times.")],
    model: _Model = "default",
    lookahead: _Lookahead = 0,
    as_json: JsonOption = False,
) -> None:
    """Score connected speech: visemes, closures of /p b m/, pauses, jitter."""
    from hypermask.voice.align import align as run

    result = run(wav, phones, _settings(model, lookahead))
    if as_json:
        print_json({"model": model, **result})
        return
    for key, value in result.items():
        if key != "f1":
            console.print(f"{key.replace('_', ' '):18} {'-' if value is None else value}")
    console.print(
        "F1 of each viseme   " + ", ".join(f"{k} {v:.2f}" for k, v in result["f1"].items())
    )


@app.command()
@reports_errors
def show(
    wav: _Wav,
    phones: Annotated[
        Path | None, typer.Option(metavar="PHONES.json", help="Its phone times.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="PNG", help="Where the picture goes.")] = Path(
        "voice.png"
    ),
    model: _Model = "default",
    lookahead: _Lookahead = 0,
    as_json: JsonOption = False,
) -> None:
    """Draw sound, phones and mouth parameters as a picture."""
    import cv2
    import numpy as np

    from hypermask.storage import write_atomically
    from hypermask.voice.align import follow
    from hypermask.voice.phones import read_phones
    from hypermask.voice.picture import draw
    from hypermask.voice.wav import read_wav

    spoken = read_phones(phones) if phones is not None else []
    sound, rate_hz = read_wav(wav)
    track, frames = follow(sound, rate_hz, _settings(model, lookahead))
    arousal = np.array([frame.arousal for frame in frames])
    picture = draw(np.nan_to_num(sound), rate_hz, track, arousal, spoken)
    write_atomically(out, cv2.imencode(".png", picture)[1].tobytes())
    if as_json:
        print_json({"picture": str(out), "width": picture.shape[1], "height": picture.shape[0]})
    else:
        console.print(f"{out}: {picture.shape[1]} x {picture.shape[0]}")


@app.command()
@reports_errors
def calibrate(
    wavs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[WAV...]", help="Six takes: a, i, u, e, o, silence, in order."),
    ] = None,
    name: Annotated[str, typer.Option(help="Whose voice it is.")] = "actor",
    live: Annotated[
        bool, typer.Option("--live", help="Ask the actor, by the microphone of the show.")
    ] = False,
    sound: Annotated[
        str, typer.Option(help="The microphone's driver, where no show runs.")
    ] = "alsa",
    device: Annotated[
        str, typer.Option(help="The microphone's name (arecord -L), where no show runs.")
    ] = "hypermask_mic",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check and measure only.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Learn an actor's voice, from six takes or live; every show uses it from then on."""
    if live and (wavs or dry_run):
        raise UsageError(
            "VOICE-TAKES", "--live takes no recordings and is no trial", "Leave the others out."
        )
    if live:
        from hypermask.workers.lesson_live import teach

        result = teach(name, sound, device, _say)
        _tell(result, as_json)
        return
    _tell(_from_recordings(wavs or [], name, dry_run, as_json), as_json)


def _say(text: str) -> None:
    """What the actor is to do: beside the result, so that that can be read by programs."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(text, markup=False)


def _from_recordings(wavs: list[Path], name: str, dry_run: bool, as_json: bool) -> dict[str, Any]:
    from hypermask.voice import recurrent, speaker
    from hypermask.voice.calibrate import calibrate, check
    from hypermask.voice.resample import resample
    from hypermask.voice.takes import ASKED, PROMPTS
    from hypermask.voice.wav import read_wav

    if len(wavs) != len(ASKED):
        raise UsageError(
            "VOICE-TAKES",
            f"{len(wavs)} takes were given, {len(ASKED)} are needed",
            f"Give one recording each of {', '.join(ASKED)}, in this order, or --live.",
        )
    network = recurrent.shipped()
    takes = {}
    for asked, path in zip(ASKED, wavs, strict=True):
        takes[asked] = check(asked, resample(*read_wav(path)), network)
    bad = [(wavs[k], take) for k, take in enumerate(takes.values()) if take.problem]
    if bad and not as_json:
        for path, take in bad:
            code, what = take.problem or ("", "")
            console.print(f"{path.name} ({take.asked}): {code}: {what}")
    if bad:
        raise DataError(
            (bad[0][1].problem or ("VOICE-TAKE", ""))[0],
            "these takes cannot be used: " + ", ".join(str(path) for path, _ in bad),
            " ".join(PROMPTS[take.asked] for _, take in bad) + " Nothing was changed.",
        )
    result = calibrate(name, takes, network, speaker.load_current()[0])
    kept = str(speaker.save(result.speaker)) if result.better and not dry_run else None
    return {**result.plain(), "kept": kept is not None, "file": kept}


def _tell(result: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(result)
        return
    before, after = result["held_out_before"], result["held_out_after"]
    if result["adapted"] and after > before:
        console.print(
            f"The voice was learnt: {before:.1%} of what was held out before, {after:.1%} now."
        )
    else:
        console.print(f"The voice was understood as well before ({before:.1%}).")
    console.print(f"Paper mode uses the network of speaker {result['paper_net']}.")
    if result.get("file"):
        console.print(f"Kept in {result['file']}.")
    elif not result["kept"]:
        console.print("Nothing was changed.")


@app.command()
@reports_errors
def forget(as_json: JsonOption = False) -> None:
    """Use nobody's calibration from now on; the files stay."""
    from hypermask.voice import speaker

    speaker.forget()
    if as_json:
        print_json({"speaker": None})
    else:
        console.print("The voice is followed without calibration.")


def _settings(model: str, lookahead_ms: int) -> Any:
    from pydantic import ValidationError

    from hypermask.voice.settings import VoiceSettings

    if model not in ("default", "paper"):
        raise UsageError(
            "VOICE-MODEL", f"there is no voice model '{model}'", "Use default or paper."
        )
    try:
        return VoiceSettings.model_validate({"mode": model, "lookahead_ms": lookahead_ms})
    except ValidationError as error:
        raise UsageError(
            "VOICE-LOOKAHEAD",
            f"a look-ahead of {lookahead_ms} ms is not known",
            "Use 0, 10, 20 or 30.",
        ) from error
