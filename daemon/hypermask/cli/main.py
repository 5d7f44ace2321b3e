"""The technician's command. Exit codes: 0 fine, 1 a fault was found, 2 wrong usage."""

from __future__ import annotations

import os
import signal
import sys

# Before numpy is imported: small linear algebra gets slower with BLAS threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import typer

from hypermask.cli import (
    bench,
    bundle,
    calibrate,
    config,
    control,
    device,
    doctor,
    face,
    log,
    rehearse,
    status,
    stream,
    update,
    voice,
)
from hypermask.cli.output import fail
from hypermask.errors import UsageError

app = typer.Typer(
    name="hypermask",
    help="Projects a living face on to an actor's moving mask.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command("rehearse")(rehearse.rehearse)
app.command("bench")(bench.bench)
app.command("doctor")(doctor.doctor)
app.command("status")(status.status)
app.command("log")(log.log)
app.command("bundle")(bundle.bundle)
app.command("cue")(control.cue)
app.command("blackout")(control.blackout)
app.command("light")(control.light)
app.command("character")(control.character)
app.command("head")(control.head)
app.command("press")(control.press)
app.command("mode")(control.mode)
app.command("reload")(control.reload)
app.add_typer(calibrate.app, name="calibrate")
app.add_typer(config.app, name="config")
app.add_typer(device.app, name="device")
app.add_typer(face.app, name="face")
app.add_typer(voice.app, name="voice")
app.add_typer(stream.app, name="stream")
app.add_typer(update.app, name="update")


def _terminated(number: int, frame: object) -> None:
    """SIGTERM ends like Ctrl-C: what is half done is cleaned up."""
    raise KeyboardInterrupt


def main() -> None:
    signal.signal(signal.SIGTERM, _terminated)
    if "--json" not in sys.argv[1:]:
        app()
        return
    try:
        sys.exit(app(standalone_mode=False) or 0)
    except _refusal() as error:
        what = error.format_message().rstrip(".")  # type: ignore[attr-defined]
        sys.exit(fail(UsageError("USAGE", what, "Try it with --help."), as_json=True).exit_code)
    except typer.Abort:
        sys.exit(130)


def _refusal() -> type[Exception]:
    """What click says of a wrong command line; newer releases of typer have a click inside."""
    kinds = typer.BadParameter.__mro__
    return next(kind for kind in kinds if kind.__name__ == "ClickException")


if __name__ == "__main__":
    main()
