"""`hypermask stream`: mouth, expression and head from one hypermask to another."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from hypermask.cli.output import JsonOption, finite, reports_errors

app = typer.Typer(help="Send or receive a performance (10 kbit/s).", no_args_is_help=True)

MachineOption = Annotated[
    Path | None, typer.Option("--machine", help="TOML file with a table [stream].")
]
HostOption = Annotated[str | None, typer.Option("--host", help="In place of the file's.")]
PortOption = Annotated[int | None, typer.Option("--port", help="In place of the file's.")]
KeyOption = Annotated[Path | None, typer.Option("--key-file", help="In place of the file's.")]
BoardOption = Annotated[
    Path | None, typer.Option("--board", help="A blackboard's folder, in place of the show's here.")
]
SecondsOption = Annotated[
    float | None, typer.Option("--seconds", help="End after so long; without it, never.", min=0)
]


@app.command()
@reports_errors
def send(
    machine: MachineOption = None,
    host: HostOption = None,
    port: PortOption = None,
    key_file: KeyOption = None,
    board: BoardOption = None,
    seconds: SecondsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Send what plays on this machine's blackboard."""
    from hypermask import paths
    from hypermask.stream.guard import next_session
    from hypermask.stream.link import UdpSender
    from hypermask.stream.settings import SendSettings, StreamSettings, load_key, load_stream
    from hypermask.workers.board import Board
    from hypermask.workers.running import running_board
    from hypermask.workers.stream import StreamSender
    from hypermask_drivers.clock import RealClock

    chosen = (load_stream(machine) if machine else StreamSettings()).send
    settings = _changed(SendSettings, chosen, host, port, key_file)
    link = UdpSender(settings.host, settings.port)
    worker = StreamSender(
        link, Board.reading(board or running_board()), RealClock(), _reporter(as_json),
        next_session(paths.home() / "stream-sent"), settings, load_key(settings.key_file),
    )  # fmt: skip
    try:
        _run(lambda: worker.step(0.1), seconds)
    finally:
        link.close()
        _end(as_json, {"sent": worker.sent, "bytes": worker.sent_bytes})


@app.command()
@reports_errors
def receive(
    machine: MachineOption = None,
    host: HostOption = None,
    port: PortOption = None,
    key_file: KeyOption = None,
    show: Annotated[
        Path | None, typer.Option("--show", help="Show file whose face is driven.")
    ] = None,
    board: BoardOption = None,
    seconds: SecondsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Play another's stream on to this machine's blackboard, in the place of its voice."""
    from hypermask import paths
    from hypermask.show.engine import ShowEngine
    from hypermask.show.showfile import load_show
    from hypermask.stream.guard import Guard
    from hypermask.stream.link import UdpReceiver
    from hypermask.stream.settings import ReceiveSettings, StreamSettings, load_key, load_stream
    from hypermask.workers.board import Board
    from hypermask.workers.running import running_board
    from hypermask.workers.stream import StreamReceiver
    from hypermask_drivers.clock import RealClock

    chosen = (load_stream(machine) if machine else StreamSettings()).receive
    settings = _changed(ReceiveSettings, chosen, host, port, key_file)
    key = load_key(settings.key_file)
    scene = ShowEngine(load_show(show), time.monotonic()).scene if show else None
    link = UdpReceiver(settings.host, settings.port, settings.senders)
    guard = Guard(key is not None, paths.home() / "stream-heard")
    own = Board.shared(board or running_board())
    worker = StreamReceiver(link, own, RealClock(), _reporter(as_json), settings, key, guard, scene)
    try:
        _run(lambda: worker.step(0.01), seconds)
    finally:
        link.close()
        _end(as_json, {**worker.status(), "strangers": link.strangers})


def _changed(model: Any, chosen: Any, host: str | None, port: int | None, key: Path | None) -> Any:
    from hypermask.config import parse

    changes = {"host": host, "port": port, "key_file": key}
    given = {name: value for name, value in changes.items() if value is not None}
    return parse(model, {**chosen.model_dump(), **given}, "the command line")


def _run(step: Callable[[], object], seconds: float | None) -> None:
    end_s = None if seconds is None else time.monotonic() + seconds
    while end_s is None or time.monotonic() < end_s:
        step()


def _reporter(as_json: bool) -> Callable[[float, str, str], None]:
    def report(time_s: float, code: str, text: str) -> None:
        if as_json:
            print(json.dumps(finite({"time_s": time_s, "code": code, "text": text})), flush=True)
        else:
            print(f"{code}: {text.removeprefix(code + ': ')}", file=sys.stderr, flush=True)

    return report


def _end(as_json: bool, result: dict[str, Any]) -> None:
    if as_json:
        print(json.dumps(finite({"result": result})), flush=True)
    else:
        print(", ".join(f"{name} {value}" for name, value in result.items()))
