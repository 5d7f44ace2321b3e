"""Orders to the dresser: small files in a folder, which outlive whoever placed or took them.

NAME.json      an order, whole from the first moment it is seen
NAME.photo     the photograph that came with it, where the dresser may not read the place it is from
NAME.done      what became of it; the last few are kept
"""

from __future__ import annotations

import contextlib
import json
import time
from pathlib import Path
from typing import Any

from pydantic import Field

from hypermask.config import Settings, parse
from hypermask.errors import HypermaskError
from hypermask.face.character import check_name
from hypermask.storage import write_atomically

ORDERS = "orders"
"""Their folder, in the board's folder."""
PHOTO = ".photo"
_KEPT = 32


class Order(Settings):
    """photo: a picture of which a character is made; source: what to call it, where that is not its
    name; character: or the folder of one that is made already. appear: at once, not when its turn
    comes. size: texels of its texture's side. ordered_s: clock time (CLOCK_MONOTONIC) of the order.
    """

    name: str
    photo: str | None = None
    source: str | None = None
    character: str | None = None
    appear: bool = True
    size: int = 512
    ordered_s: float = Field(0.0, ge=0)


def place(folder: Path, order: Order, photo: bytes | None = None) -> str:
    """Returns the order's number. photo: the picture's bytes, in place of a file that the dresser
    can read. Raises `UsageError` CHAR-NAME, `HypermaskError` DISK-WRITE."""
    check_name(order.name)
    number = f"{time.time_ns():020d}-{order.name}"
    copy = folder / f"{number}{PHOTO}"
    if photo is not None:
        write_atomically(copy, photo)
        order = order.model_copy(update={"photo": str(copy)})
    try:
        write_atomically(folder / f"{number}.json", order.model_dump_json().encode())
    except HypermaskError:
        copy.unlink(missing_ok=True)
        raise
    return number


def oldest(folder: Path) -> tuple[str, Order] | None:
    """The order that has waited longest; one that cannot be read is answered and left out."""
    for path in sorted(folder.glob("*.json")):
        try:
            return path.stem, parse(Order, json.loads(path.read_text("utf-8")), path.name)
        except (OSError, ValueError, HypermaskError) as error:
            told = {"error": "ORDER-READ", "what": str(error), "remedy": "Order again."}
            with contextlib.suppress(HypermaskError):  # a full disk: nobody can be told
                answer(folder, path.stem, told)
    return None


def answer(folder: Path, number: str, result: dict[str, Any]) -> None:
    """What became of an order, which is then none any more.

    Raises `HypermaskError` DISK-WRITE: then nobody is told, but it is not done again and again.
    """
    try:
        write_atomically(folder / f"{number}.done", json.dumps(result).encode())
    finally:
        (folder / f"{number}.json").unlink(missing_ok=True)
        (folder / f"{number}{PHOTO}").unlink(missing_ok=True)
    for old in sorted(folder.glob("*.done"))[:-_KEPT]:
        old.unlink(missing_ok=True)


def outcome(folder: Path, number: str) -> dict[str, Any] | None:
    """The answer to an order, None while there is none."""
    try:
        found: dict[str, Any] = json.loads((folder / f"{number}.done").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return found
