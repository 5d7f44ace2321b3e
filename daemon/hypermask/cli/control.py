"""Commands that steer the running show: cues, light, characters, head, modes."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors


def _ask(request: dict[str, Any], as_json: bool) -> dict[str, Any]:
    """Ask the show, and print its answer's text or all of it."""
    from hypermask.workers.control import ask

    answer = ask(request)
    if as_json:
        print_json({key: value for key, value in answer.items() if key != "ok"})
    elif "text" in answer:
        console.print(answer["text"], markup=False)
    return answer


@reports_errors
def cue(
    name: Annotated[str | None, typer.Argument(help="The cue to call.")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the show's cues.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Call a cue of the running show, as its key would."""
    from hypermask.errors import UsageError

    if listed == (name is not None):
        raise UsageError("CUE-NAME", "one cue is called at a time", "Name one, or use --list.")
    if name is not None:
        _ask({"do": "cue", "name": name}, as_json)
        return
    from hypermask.workers.control import ask

    found = ask({"do": "cues"})
    if as_json:
        print_json({key: found[key] for key in ("show", "cues", "characters")})
        return
    for entry in found["cues"]:
        console.print(f"{entry['key'] or '-':10} {entry['name']}", markup=False)


@reports_errors
def blackout(
    to: Annotated[str, typer.Argument(metavar="[on|off|toggle]", help="Dark or lit.")] = "on",
    as_json: JsonOption = False,
) -> None:
    """Make the stage dark, or bring the light back."""
    from hypermask.errors import UsageError

    if to not in ("on", "off", "toggle"):
        raise UsageError("CTL-VALUE", f"a blackout is not '{to}'", "Say on, off or toggle.")
    _ask({"do": "blackout", "to": to}, as_json)


@reports_errors
def light(
    level: Annotated[float, typer.Argument(help="0.1 to 1; blackout makes it dark.")],
    as_json: JsonOption = False,
) -> None:
    """Set how bright the face is."""
    _ask({"do": "brightness", "level": level}, as_json)


@reports_errors
def character(
    name: Annotated[str, typer.Argument(help="A character's name, next or previous.")],
    as_json: JsonOption = False,
) -> None:
    """Let a character play; one that is not in the show is fetched."""
    _ask({"do": "character", "name": name}, as_json)


@reports_errors
def head(
    gesture: Annotated[str, typer.Argument(metavar="nod|shake|park|look")],
    pan: Annotated[float | None, typer.Option(help="Where to look, degrees to the left.")] = None,
    tilt: Annotated[float | None, typer.Option(help="Where to look, degrees up.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Move the head, where the mask sits on a pan-tilt unit."""
    look = None if pan is None and tilt is None else [pan or 0.0, tilt or 0.0]
    _ask({"do": "gesture", "name": gesture, "look": look}, as_json)


@reports_errors
def press(
    keys: Annotated[list[str], typer.Argument(help="Keys of the keypad, such as 5 enter star.")],
    as_json: JsonOption = False,
) -> None:
    """Press keys as at the keypad, also in a mode."""
    from hypermask.workers.control import ask

    answers = []
    for key in keys:
        answers.append(answer := ask({"do": "press", "key": key}))
        if not as_json:
            called = f" It calls '{answer['cue']}'." if answer.get("cue") else ""
            console.print(f"{answer['text']}{called}", markup=False)
    if as_json:
        print_json(
            [{"key": key, "cue": a.get("cue")} for key, a in zip(keys, answers, strict=True)]
        )


@reports_errors
def mode(
    action: Annotated[str, typer.Argument(metavar="show|begin|cancel")] = "show",
    name: Annotated[str | None, typer.Argument(help="calibrate or lesson.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Which mode has the keypad; begin one, or leave it."""
    from hypermask.workers.control import ask

    if action == "show":
        found = ask({"do": "status"})
        answer = {key: found[key] for key in ("mode", "words", "modes")}
    else:
        answer = ask({"do": "mode", "action": action, "name": name})
        answer.pop("ok", None)
    if as_json:
        print_json(answer)
    elif answer["mode"]:
        console.print(f"{answer['mode']}: {answer['words']}", markup=False)
    else:
        known = ", ".join(answer.get("modes", ())) or "none"
        text = (
            f"The keypad calls cues. Modes: {known}." if action == "show" else "The mode is over."
        )
        console.print(text, markup=False)


@reports_errors
def reload(as_json: JsonOption = False) -> None:
    """Let the running show read its show file again."""
    _ask({"do": "reload"}, as_json)
