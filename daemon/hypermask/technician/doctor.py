"""The doctor: one check after the other, each with cause and remedy, and safe fixes for some."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hypermask.errors import HypermaskError
from hypermask.technician import checks, checks_appliance
from hypermask.technician.checks_appliance import is_appliance


@dataclass(frozen=True)
class Check:
    """look: words when all is well, raises `HypermaskError` when not. fix: does something safe
    and says what it did; raises `HypermaskError` when it cannot."""

    name: str
    look: Callable[[], str]
    fix: Callable[[], str] | None = None


@dataclass(frozen=True)
class Finding:
    """code: empty when fine. fixed: what `--fix` did, empty for nothing."""

    check: str
    fine: bool
    message: str
    code: str = ""
    fixable: bool = False
    fixed: str = ""


EVERYWHERE = (
    Check("graphics", checks.graphics),
    Check("face models", checks.models),
    Check("characters", checks.characters),
    Check("show", checks.show),
    Check("configuration", checks.configuration),
    Check("folders", checks.folders, checks.make_folders),
    Check("disk", checks.disk),
    Check("blackboard", checks.blackboard, checks.remove_blackboard),
    Check("heat", checks.heat),
)
AT_HOME = (
    Check("calibration", checks.calibration),
    Check("ffmpeg", checks.program("ffmpeg", "so no film is written")),
    Check("espeak-ng", checks.program("espeak-ng", "so the built-in speech is silent")),
)
"""On a developer's machine, for rehearsals."""
ON_THE_CART = (
    Check("calibration", checks_appliance.calibration),
    Check("account", checks_appliance.account),
    Check("you", checks_appliance.operator),
    Check("services", checks_appliance.services, checks_appliance.restart_failed),
    Check("start-up", checks_appliance.start_up, checks_appliance.enable),
    Check("watchdog", checks_appliance.watchdog),
    Check("clock", checks_appliance.clock),
    Check("timing", checks_appliance.timing),
    Check("devices", checks_appliance.devices),
    Check("sound", checks_appliance.sound),
    Check("last fault", checks_appliance.last_fault),
)


def all_checks() -> tuple[Check, ...]:
    return (*EVERYWHERE, *(ON_THE_CART if is_appliance() else AT_HOME))


def examine(fix: bool = False, chosen: tuple[Check, ...] | None = None) -> list[Finding]:
    """Every check's finding. With `fix` what is wrong and can safely be mended is, and looked at
    again."""
    return [_examined(check, fix) for check in (all_checks() if chosen is None else chosen)]


def _examined(check: Check, fix: bool) -> Finding:
    finding = _look(check)
    if finding.fine or not fix or check.fix is None:
        return finding
    try:
        done = check.fix()
    except HypermaskError as error:
        return Finding(
            check.name, False, f"{finding.message} Not mended: {error}", finding.code, True
        )
    again = _look(check)
    return Finding(check.name, again.fine, again.message, again.code, True, done)


def _look(check: Check) -> Finding:
    fixable = check.fix is not None
    try:
        return Finding(check.name, True, check.look(), fixable=fixable)
    except HypermaskError as error:
        return Finding(check.name, False, str(error), error.code, fixable)
    except Exception as error:  # one check that fails must not hide the others
        text = f"DOC-CHECK: this check failed ({type(error).__name__}: {error}). Look by hand."
        return Finding(check.name, False, " ".join(text.split()), "DOC-CHECK", fixable)
