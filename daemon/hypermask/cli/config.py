"""`hypermask config`: what this machine is configured to be."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors

app = typer.Typer(no_args_is_help=True, help="Show, check and change the machine's configuration.")


@app.command("show")
@reports_errors
def show(
    all_values: Annotated[bool, typer.Option("--all", help="Also what has its default.")] = False,
    as_json: JsonOption = False,
) -> None:
    """The configuration in use, all layers in one."""
    from hypermask.machine.files import complaint, load
    from hypermask.machine.toml import dumps

    loaded = load()
    data = loaded.machine.model_dump(mode="json", exclude_unset=not all_values)
    if as_json:
        print_json({"origin": loaded.origin, "machine": data})
    else:
        if loaded.problem is not None:
            console.print(f"# CFG-LASTGOOD: {complaint(loaded)}")
        console.print(dumps(data), end="")


@app.command("check")
@reports_errors
def check(as_json: JsonOption = False) -> None:
    """Whether the configuration can be used. Exit code 1 when another one takes its place."""
    from hypermask.machine.files import complaint, layer_paths, load
    from hypermask.services.playbill import checked_show

    loaded = load()
    problems = []
    if loaded.problem is not None:
        problems.append(("CFG-LASTGOOD", complaint(loaded)))
    problems += _content_problem(loaded.machine)
    problems += _show_problem(checked_show, loaded.machine.show)
    if as_json:
        print_json(_checked(loaded.origin, [str(path) for path in layer_paths()], problems))
    else:
        for code, text in problems:
            console.print(f"{code}: {text}")
        if not problems:
            names = ", ".join(path.name for path in layer_paths()) or "no files of your own"
            console.print(f"The configuration is good: {loaded.machine.name} with {names}.")
    if problems:
        raise typer.Exit(1)


def _content_problem(machine: Any) -> list[tuple[str, str]]:
    from hypermask.errors import ConfigError
    from hypermask.machine.places import check_contents

    try:
        check_contents(machine)
    except ConfigError as error:
        return [(error.code, f"{error.what}. {error.remedy}")]
    return []


def _show_problem(checked_show: Any, name: str) -> list[tuple[str, str]]:
    from hypermask.errors import HypermaskError

    try:
        checked_show(name)
    except HypermaskError as error:
        return [("SHOW-FALLBACK", f"the default show plays: {error}")]
    return []


def _checked(origin: str, files: list[str], problems: list[tuple[str, str]]) -> dict[str, Any]:
    told = [{"code": code, "text": text} for code, text in problems]
    return {"good": not problems, "origin": origin, "files": files, "problems": told}


@app.command("set")
@reports_errors
def set_value(
    assignment: Annotated[str, typer.Argument(help="table.key=value, the value as in TOML.")],
    as_json: JsonOption = False,
) -> None:
    """Change one value, if all together is then still good. It holds from the next start on."""
    from hypermask.machine.files import SET_FILE, etc
    from hypermask.machine.files import set_value as store
    from hypermask.services.playbill import checked_show

    def check_show(machine: Any) -> None:
        if assignment.partition("=")[0].strip() == "show":
            checked_show(machine.show)

    store(assignment, check_show)
    if as_json:
        print_json({"set": assignment, "file": str(etc() / SET_FILE)})
    else:
        console.print(f"Written to {etc() / SET_FILE}. It holds from the next start on.")
