"""`hypermask update`: packages in, a running show on to them, and back again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors

if TYPE_CHECKING:
    from hypermask.update.dpkg import Dpkg
    from hypermask.update.shelf import Shelf

app = typer.Typer(no_args_is_help=True, help="Install a new version, or go back to the last one.")
NowOption = Annotated[
    bool, typer.Option("--now", help="Into the running show at once, whoever looks.")
]


@app.command("install")
@reports_errors
def install(
    packages: Annotated[list[Path], typer.Argument(help="hypermask_*.deb")],
    now: NowOption = False,
    as_json: JsonOption = False,
) -> None:
    """Install a package. A running show takes it over when nobody looks."""
    # Everything is imported before dpkg changes the files under this program.
    from hypermask.update.install import install as do_install
    from hypermask.update.takeover import pending, switch

    shelf, dpkg = _tools()
    done = do_install(packages, shelf, dpkg, _teller(as_json))
    _finish(done.version, done.before, now and pending(), pending(), switch, as_json)


@app.command("rollback")
@reports_errors
def rollback(now: NowOption = False, as_json: JsonOption = False) -> None:
    """Go back to the version before; once more comes forward again."""
    from hypermask.update.install import rollback as do_rollback
    from hypermask.update.takeover import pending, switch

    shelf, dpkg = _tools()
    done = do_rollback(shelf, dpkg, _teller(as_json))
    _finish(done.version, done.before, now and pending(), pending(), switch, as_json)


@app.command("now")
@reports_errors
def now_(as_json: JsonOption = False) -> None:
    """Let the running show take the installed version over at once: it is dark for a moment."""
    import os

    from hypermask.errors import UsageError
    from hypermask.update.takeover import installed_release, pending, switch

    waiting = pending()
    if waiting:
        if os.geteuid() != 0:
            raise UsageError("UPD-ROOT", "starting the show anew needs root", "Use sudo.")
        switch()
    if as_json:
        print_json({"switched": waiting, "release": installed_release()})
    else:
        said = "The show plays with" if waiting else "Nothing to do: the show already plays with"
        console.print(f"{said} {installed_release() or 'what there is'}.")


@app.command("status")
@reports_errors
def status(as_json: JsonOption = False) -> None:
    """What is installed, what plays, and where one can go back to. Exit code 1: interrupted."""
    from hypermask.update import takeover

    shelf, dpkg = _tools()
    previous = shelf.previous
    found: dict[str, Any] = {
        "installed": dpkg.version(),
        "installed_release": takeover.installed_release(),
        "playing_release": takeover.playing_release(),
        "waits_for_idle": takeover.pending(),
        "previous": previous if previous and shelf.kept(previous) else None,
        "interrupted": shelf.interrupted,
        "kept": sorted(path.name for path in shelf.folder.glob("*.deb")),
    }
    if as_json:
        print_json(found)
    else:
        for line in _lines(found):
            console.print(line)
    if shelf.interrupted:
        raise typer.Exit(1)


def _lines(found: dict[str, Any]) -> list[str]:
    plays = found["playing_release"] or "no show runs"
    waits = "; the new one comes when nobody looks (or: hypermask update now)"
    lines = [
        f"installed  {found['installed'] or 'not by a package'}",
        f"plays      {plays}{waits if found['waits_for_idle'] else ''}",
        f"back to    {found['previous'] or 'nothing is kept'}",
    ]
    if found["interrupted"]:
        lines.append("UPD-HALF: an installation was interrupted. The machine's next start ends it.")
    return lines


def _finish(
    version: str, before: str | None, now: bool, waits: bool, switch: Any, as_json: bool
) -> None:
    if now:
        switch()
    if as_json:
        print_json({"installed": version, "before": before, "waits_for_idle": waits and not now})
        return
    console.print(f"Version {version} is installed.")
    if waits and not now:
        console.print("The show takes it over when nobody looks (or: hypermask update now).")


def _teller(as_json: bool) -> Any:
    return (lambda text: None) if as_json else (lambda text: console.print(text, markup=False))


def _tools() -> tuple[Shelf, Dpkg]:
    from hypermask.update.dpkg import Dpkg
    from hypermask.update.shelf import Shelf, shelf_folder

    dpkg = Dpkg()
    return Shelf(shelf_folder(), dpkg), dpkg
