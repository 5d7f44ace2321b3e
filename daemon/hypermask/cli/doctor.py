"""`hypermask doctor`: what is missing on this machine, and what to do about it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors
from hypermask.errors import HypermaskError


@dataclass(frozen=True)
class Finding:
    check: str
    fine: bool
    message: str


def _program(name: str, why: str) -> Callable[[], str]:
    def check() -> str:
        found = shutil.which(name)
        if found is None:
            raise HypermaskError("DOC-PROGRAM", f"{name} is absent, {why}", f"apt install {name}")
        return found

    return check


def _graphics() -> str:
    from hypermask_drivers.projector.gles import create_context

    context = create_context()
    name = f"{context.info['GL_RENDERER']}, {context.info['GL_VERSION']}"
    context.release()
    return name


def _models() -> str:
    from hypermask.texture.landmarks import FaceFinder

    FaceFinder()
    return "both load"


def _characters() -> str:
    from hypermask.face.character import find_character, known_characters, load_character

    for name in known_characters():
        load_character(find_character(name))
    return ", ".join(known_characters())


def _show() -> str:
    from hypermask import paths
    from hypermask.show.expressions import expressions_of
    from hypermask.show.showfile import load_show

    path = paths.configs() / "shows" / "default.toml"
    show = load_show(path)
    expressions_of(show, str(path))
    return show.name


def _calibration() -> str:
    from hypermask.calibration import storage

    if not storage.history():
        return "none yet: a rehearsal makes its own, a cart is calibrated with the keypad"
    _, warning = storage.load_current()
    if warning is not None:
        raise HypermaskError("DOC-CALIBRATION", warning.rstrip("."), "Calibrate again.")
    return f"{len(storage.history())} stored, the newest is good"


CHECKS: dict[str, Callable[[], str]] = {
    "graphics": _graphics,
    "face models": _models,
    "characters": _characters,
    "show": _show,
    "calibration": _calibration,
    "ffmpeg": _program("ffmpeg", "so no film is written"),
    "espeak-ng": _program("espeak-ng", "so the built-in speech is silent"),
}


@reports_errors
def doctor(as_json: JsonOption = False) -> None:
    """Check what a rehearsal needs; exit code 1 when something is missing."""
    findings = []
    for name, check in CHECKS.items():
        try:
            findings.append(Finding(name, True, check()))
        except HypermaskError as error:
            findings.append(Finding(name, False, str(error)))
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        for finding in findings:
            console.print(
                f"{'ok   ' if finding.fine else 'FAULT'} {finding.check}: {finding.message}"
            )
    if not all(finding.fine for finding in findings):
        raise typer.Exit(1)
