"""`hypermask face`: characters from photographs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hypermask.cli import face_tools
from hypermask.cli.output import JsonOption, console, print_json, reports_errors
from hypermask.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_ORDER_TIMEOUT_S = 30.0

app = typer.Typer(help="Make and look at characters.", no_args_is_help=True)
app.command("fit")(face_tools.fit)
app.command("export")(face_tools.export)


@app.command("build")
@reports_errors
def build(
    photo: Annotated[Path, typer.Argument(help="A frontal photograph of one face.")],
    name: Annotated[str, typer.Option(help="The character's name.")],
    out: Annotated[
        Path | None, typer.Option(help="The folder to make it in (default: the user's characters).")
    ] = None,
    fine: Annotated[bool, typer.Option("--fine", help="1024 texels instead of 512.")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="By the show that runs here, and into it at once.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a character from one photograph."""
    from hypermask import paths
    from hypermask.face.character import check_name
    from hypermask.texture.build import build_character
    from hypermask.texture.normalise import FINE_SIZE, SIZE

    check_name(name)
    if out is None and (paths.configs() / "characters" / name).exists():
        raise UsageError("CHAR-NAME", f"'{name}' is a built-in character", "Choose another name.")
    shelf = out or paths.home() / "characters"
    size = FINE_SIZE if fine else SIZE
    if live:
        _order(photo, name, size, as_json)
        return
    told: list[str] = []
    folder = shelf / build_character(photo, name, shelf, size=size, tell=told.append).name
    if as_json:
        print_json({"name": name, "folder": str(folder), "advice": told})
    else:
        console.print(f"The character '{name}' is ready in {folder}")
        for sentence in told:
            console.print(sentence)
        console.print(f"Try it: hypermask rehearse --set character={folder}")


def _order(photo: Path, name: str, size: int, as_json: bool) -> None:
    """Have the running show make the character; wait for what becomes of it."""
    import time

    from hypermask.errors import DataError
    from hypermask.texture.photo import photo_bytes
    from hypermask.workers import orders
    from hypermask.workers.orders import ORDERS
    from hypermask.workers.running import running_board

    folder = running_board() / ORDERS
    began_s = time.monotonic()
    order = orders.Order(name=name, source=photo.name, size=size, ordered_s=began_s)
    number = orders.place(folder, order, photo_bytes(photo))  # its own place the show may not see
    while (told := orders.outcome(folder, number)) is None:
        if time.monotonic() - began_s > _ORDER_TIMEOUT_S:
            raise DataError("ORDER-LATE", "the show does not answer", "Is its dresser alive?")
        time.sleep(0.02)
    if "error" in told:
        copy = str(folder / f"{number}{orders.PHOTO}")
        raise DataError(told["error"], told["what"].replace(copy, str(photo)), told["remedy"])
    seconds = round(time.monotonic() - began_s, 2)
    if as_json:
        print_json({"name": name, "seconds": seconds})
    else:
        console.print(f"The character '{name}' joins the show; made in {seconds:.2f} s")


@app.command("prepare")
@reports_errors
def prepare(as_json: JsonOption = False) -> None:
    """Make what the stage needs of the show's characters, as a running show does in passing.

    For whoever copies an appliance's disk: the first start is then as quick as any other.
    """
    from hypermask.machine.files import load
    from hypermask.machine.places import mask_folder
    from hypermask.mask import load_mask
    from hypermask.services.playbill import checked_show
    from hypermask.workers.costumes import Costumes

    machine = load().machine
    store, mask = Costumes(machine.stage.projector_gamma), load_mask(mask_folder(machine.mask))
    names = checked_show(machine.show).characters
    made = [name for name in names if store.sew(name, mask)]
    if as_json:
        print_json({"characters": list(names), "made": made})
    else:
        console.print(f"Made: {', '.join(made) or 'nothing'}. Ready: {', '.join(names)}")


@app.command("list")
@reports_errors
def list_characters(as_json: JsonOption = False) -> None:
    """The characters that can play."""
    from hypermask.face.character import find_character, known_characters

    known = known_characters()
    folders = {name: str(find_character(name)) for name in known}
    if as_json:
        print_json(folders)
        return
    for name, folder in folders.items():
        console.print(f"{name:16} {folder}")


@app.command("sheet")
@reports_errors
def sheet(
    name: Annotated[str, typer.Argument(help="A character's name or folder.")],
    out: Annotated[Path, typer.Option(help="The picture to write.")] = Path("sheet.png"),
    projected: Annotated[
        bool, typer.Option(help="Also draw it as projected, in a second picture.")
    ] = True,
    as_json: JsonOption = False,
) -> None:
    """Draw all that a character's face can do: emotions, mouth shapes, looks, turns and every
    action unit; on a second page the same on a mask on the stage."""
    from hypermask import paths
    from hypermask.face.character import find_character, load_character
    from hypermask.face.sheet import sheet as draw
    from hypermask.mask import load_mask

    mask = load_mask(paths.configs() / "masks" / "reference")
    character = load_character(find_character(name))
    _write_picture(out, draw(character, mask))
    told = {"picture": str(out)}
    if projected:
        from hypermask.rehearsal.face_sheet import projected_sheet

        second = out.with_stem(f"{out.stem}-projected")
        _write_picture(second, projected_sheet(character, mask))
        told["projected"] = str(second)
    if as_json:
        print_json(told)
    else:
        console.print(f"Look at {' and '.join(told.values())}")


def _write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    import cv2

    from hypermask.storage import write_atomically

    write_atomically(path, cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
