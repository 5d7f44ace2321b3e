"""`hypermask face fit` and `face export`: correct a character's fit, take it elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors
from hypermask.errors import UsageError

if TYPE_CHECKING:
    from hypermask.fitting.session import Fitting


@reports_errors
def export(
    name: Annotated[str, typer.Argument(help="A character's name or folder.")],
    out: Annotated[Path, typer.Option(help="The file to write, .glb.")],
    shapes: Annotated[
        str,
        typer.Option(
            help="Blendshapes: arkit (ARKit's 52), units (the 44 action units, five visemes and a "
            "clip for each emotion) or both."
        ),
    ] = "arkit",
    as_json: JsonOption = False,
) -> None:
    """Write a character as glTF 2.0 for games and other tools: meshes, textures, blendshapes.

    Metres, y up, the face looks along +z; the blendshapes' names are in mesh.extras.targetNames.
    """
    from hypermask import paths
    from hypermask.face.character import find_character, load_character
    from hypermask.face.gltf import export_glb
    from hypermask.face.gltf_shapes import SHAPES, targets
    from hypermask.mask import load_mask
    from hypermask.storage import write_atomically

    chosen = next((known for known in SHAPES if known == shapes), None)
    if chosen is None:
        raise UsageError(
            "GLTF-SHAPES", f"there is no set '{shapes}'", f"Known: {', '.join(SHAPES)}."
        )
    if out.suffix.lower() != ".glb":
        raise UsageError("GLTF-NAME", f"{out} does not end in .glb", "Name the file so.")
    mask = load_mask(paths.configs() / "masks" / "reference")
    data = export_glb(load_character(find_character(name)), mask, chosen)
    write_atomically(out, data)
    count = len(targets(chosen))
    if as_json:
        print_json({"file": str(out), "bytes": len(data), "shapes": count})
    else:
        console.print(f"{out}: {count} blendshapes, {len(data) / 1e6:.1f} MB")


@reports_errors
def fit(
    name: Annotated[str, typer.Argument(help="A character's name or folder.")],
    apply: Annotated[
        Path | None,
        typer.Option(
            help='A JSON list of drags, such as [{"handle": "parts/brow_left", "by": [0, -4]}], '
            "carried out in their order and saved with the character."
        ),
    ] = None,
    photo: Annotated[
        Path | None, typer.Option(help="The photograph, where the character's folder has none.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="A picture to write: the mesh over the photograph, handles, texture."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Look at how the mesh lies on the photograph, and correct it.

    The mesh has handles in four levels: face (3: eyes and mouth, they turn and stretch all),
    parts (13), features (48) and points (each vertex). A drag is {"handle": NAME, "x": X, "y": Y}
    in the photograph's pixels, or "by": [DX, DY]. In the list may also stand {"do": "mirror",
    "on": true}, {"do": "undo"} and {"do": "reset", "level": LEVEL}. Start with the coarse levels;
    --json names all handles of the first three levels and where they are.
    """
    from hypermask.face.character import find_character
    from hypermask.fitting.storage import open_fit

    stored = open_fit(find_character(name), photo)
    answers = [] if apply is None else _carry_out(stored.fitting, apply)
    if apply is not None:
        stored.save()
    if out is not None:
        _write_fit_picture(stored.fitting, out)
    _tell_fit(stored.fitting, answers, stored.kept, out, as_json)


def _carry_out(fitting: Fitting, path: Path) -> list[dict[str, Any]]:
    """The answers to a file's requests, in order. Raises `UsageError` FIT-*, CFG-*."""
    import json

    from hypermask.fitting.protocol import answer

    try:
        requests = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(
            "FIT-REQUEST", f"{path} cannot be read: {error}", "Give a file with a JSON list."
        ) from error
    if not isinstance(requests, list):
        raise UsageError("FIT-REQUEST", f"{path} holds no list", "Give a JSON list of drags.")
    return [answer(fitting, request) for request in requests]


def _write_fit_picture(fitting: Fitting, out: Path) -> None:
    import cv2

    from hypermask import paths
    from hypermask.fitting.picture import fit_picture
    from hypermask.mask import load_mask
    from hypermask.storage import write_atomically

    picture = fit_picture(fitting, load_mask(paths.configs() / "masks" / "reference"))
    write_atomically(out, cv2.imencode(".png", picture[..., ::-1])[1].tobytes())


def _tell_fit(
    fitting: Fitting, answers: list[dict[str, Any]], kept: float, out: Path | None, as_json: bool
) -> None:
    from hypermask.fitting.protocol import handles, state

    now = state(fitting)
    if as_json:
        listed = {level: handles(fitting, level)["handles"] for level in _TOLD_LEVELS}
        picture = None if out is None else str(out)
        print_json({**now, "handles": listed, "answers": answers, "kept": kept, "picture": picture})
        return
    for level in now["levels"]:
        console.print(f"{level['name']:10} {level['handles']:4} handles, {level['moved']} moved")
    for told in answers:
        if "notice" in told:
            console.print(f"{told['notice']['code']}: {told['notice']['what']}")
    if kept < 1:
        console.print(f"The mesh has changed: {kept:.0%} of the stored corrections were kept")
    if out is not None:
        console.print(f"Look at {out}")


_TOLD_LEVELS = ("face", "parts", "features")
