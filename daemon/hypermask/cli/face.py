"""`hypermask face`: characters from photographs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors
from hypermask.errors import UsageError

app = typer.Typer(help="Make and look at characters.", no_args_is_help=True)


@app.command("build")
@reports_errors
def build(
    photo: Annotated[Path, typer.Argument(help="A frontal photograph of one face.")],
    name: Annotated[str, typer.Option(help="The character's name.")],
    out: Annotated[
        Path | None, typer.Option(help="The folder to make it in (default: the user's characters).")
    ] = None,
    fine: Annotated[bool, typer.Option("--fine", help="1024 texels instead of 512.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a character from one photograph."""
    from hypermask import paths
    from hypermask.texture.build import build_character
    from hypermask.texture.normalise import FINE_SIZE, SIZE

    if out is None and (paths.configs() / "characters" / name).exists():
        raise UsageError("CHAR-NAME", f"'{name}' is a built-in character", "Choose another name.")
    shelf = out or paths.home() / "characters"
    size = FINE_SIZE if fine else SIZE
    told: list[str] = []
    folder = shelf / build_character(photo, name, shelf, size=size, tell=told.append).name
    if as_json:
        print_json({"name": name, "folder": str(folder), "advice": told})
    else:
        console.print(f"The character '{name}' is ready in {folder}")
        for sentence in told:
            console.print(sentence)
        console.print(f"Try it: hypermask rehearse --set character={folder}")


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
    as_json: JsonOption = False,
) -> None:
    """Draw a character's emotions and mouth shapes on one page."""
    import cv2

    from hypermask import paths
    from hypermask.face.character import find_character, load_character
    from hypermask.face.sheet import sheet as draw
    from hypermask.mask import load_mask
    from hypermask.storage import write_atomically

    mask = load_mask(paths.configs() / "masks" / "reference")
    picture = draw(load_character(find_character(name)), mask)
    write_atomically(out, cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
    if as_json:
        print_json({"picture": str(out)})
    else:
        console.print(f"Look at {out}")
