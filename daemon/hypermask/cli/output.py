"""What every command shares: the error boundary and the choice between words and JSON."""

from __future__ import annotations

import functools
import json
import math
import sys
from collections.abc import Callable
from typing import Annotated, Any, ParamSpec, TypeVar

import typer
from rich.console import Console

from hypermask.errors import HypermaskError

P = ParamSpec("P")
R = TypeVar("R")

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object, for programs.")]

console = Console(highlight=False, soft_wrap=True, markup=False, emoji=False)


def print_json(data: Any) -> None:
    print(json.dumps(finite(data), indent=2, ensure_ascii=False, allow_nan=False))


def finite(data: Any) -> Any:
    """JSON has neither infinity nor NaN: null stands for them."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def fail(error: HypermaskError, as_json: bool) -> typer.Exit:
    """Print one clear line (or a JSON object) and return the exit to raise."""
    if as_json:
        print_json({"error": {"code": error.code, "what": error.what, "remedy": error.remedy}})
    print(error, file=sys.stderr)
    return typer.Exit(error.exit_code)


def reports_errors(command: Callable[P, R]) -> Callable[P, R]:
    """A command that ends a known error with one line and its exit code, never a traceback."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except HypermaskError as error:
            raise fail(error, bool(kwargs.get("as_json"))) from None
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "hypermask_sim":
                raise
            absent = HypermaskError(
                "SIM-ABSENT", "the simulated cart is not installed", "apt install hypermask-sim"
            )
            raise fail(absent, bool(kwargs.get("as_json"))) from None
        except KeyboardInterrupt:
            print("Interrupted.", file=sys.stderr)
            raise typer.Exit(130) from None

    return wrapped
