"""Checks of a machine that is a cart: accounts, services, watchdog, clock, devices."""

from __future__ import annotations

import grp
import json
import os
import pwd
import time
from pathlib import Path

from hypermask import paths
from hypermask.errors import HypermaskError
from hypermask.technician.units import SAFE, TARGET, Run, booted, run, unit_names, units

USER = "hypermask"
GROUPS = ("video", "render", "audio", "dialout", "i2c")
ROOT = Path("/")
_EARLIEST = 1_750_000_000
"""June 2025: before this was written no clock can be right."""
_RECENT_S = 7 * 86400.0


def is_appliance(root: Path = ROOT) -> bool:
    """Installed as a package, on a machine that systemd runs."""
    installed = any(
        (root / folder / TARGET).exists()
        for folder in ("usr/lib/systemd/system", "lib/systemd/system", "etc/systemd/system")
    )
    return installed and booted(root)


def calibration() -> str:
    from hypermask.calibration import storage
    from hypermask.machine.files import load

    if load().machine.mapping == "fixed" and not storage.history():
        return "none; the mask is fixed to the projector: nudge it with the keypad"
    stored, warning = storage.load_current()
    if warning is not None:
        raise HypermaskError("DOC-CALIBRATION", warning.rstrip("."), "Calibrate again.")
    return f"{stored.name}, {stored.expected_mm:.2f} mm expected"


def account() -> str:
    """The show's own user and its groups."""
    try:
        user = pwd.getpwnam(USER)
    except KeyError:
        raise HypermaskError(
            "DOC-USER", f"there is no user '{USER}'", "systemd-sysusers, or install the package."
        ) from None
    member = {group.gr_name for group in grp.getgrall() if USER in group.gr_mem}
    member.add(grp.getgrgid(user.pw_gid).gr_name)
    there = {group.gr_name for group in grp.getgrall()}
    missing = [name for name in GROUPS if name in there and name not in member]
    if missing:
        raise HypermaskError(
            "DOC-GROUPS",
            f"the user '{USER}' is not in {', '.join(missing)}",
            f"adduser {USER} {missing[0]}; then systemctl restart {TARGET}.",
        )
    return f"'{USER}' is in {', '.join(name for name in GROUPS if name in member)}"


def operator() -> str:
    """Whoever asks: root, or in the group."""
    if os.geteuid() == 0:
        return "root"
    try:
        wanted = grp.getgrnam(USER).gr_gid
    except KeyError:
        wanted = -1
    if wanted not in os.getgroups():
        raise HypermaskError(
            "DOC-YOU",
            f"you are not in the group '{USER}': status, cue and calibrate refuse you",
            f"adduser {pwd.getpwuid(os.geteuid()).pw_name} {USER}, and log in again; or use sudo.",
        )
    return f"in the group '{USER}'"


def services(run_it: Run = run) -> str:
    found = units(run_it=run_it)
    if not found:
        raise HypermaskError(
            "DOC-SERVICES", "systemd knows no service of hypermask", "systemctl daemon-reload."
        )
    failed = [unit for unit in found.values() if unit.active == "failed"]
    if failed:
        words = ", ".join(f"{unit.name} ({unit.result})" for unit in failed)
        raise HypermaskError(
            "DOC-SERVICES", f"failed: {words}", "See hypermask log; doctor --fix starts them again."
        )
    safe = found.get(SAFE)
    if safe is not None and safe.active == "active":
        raise HypermaskError(
            "DOC-SAFE",
            "the show was given up: dark and parked",
            f"See hypermask log, mend it, then systemctl restart {TARGET}.",
        )
    stopped = [
        unit.name
        for name, unit in found.items()
        if name.endswith(".service") and name != SAFE and unit.active != "active"
    ]
    target = found.get(TARGET)
    if stopped and target is not None and target.active == "active":
        raise HypermaskError(
            "DOC-SERVICES", f"not running: {', '.join(stopped)}", f"systemctl start {stopped[0]}."
        )
    if target is None or target.active != "active":
        raise HypermaskError("DOC-STOPPED", "the show is stopped", f"systemctl start {TARGET}.")
    again = sum(unit.restarts for unit in found.values())
    return f"all run; {again} restarts since the start" if again else "all run"


def restart_failed(run_it: Run = run) -> str:
    """Start what failed once more. A show that somebody stopped stays stopped, and the safe state,
    which would end the picture, is only forgotten."""
    found = units(run_it=run_it)
    failed = [unit.name for unit in found.values() if unit.active == "failed"]
    if not failed:
        raise HypermaskError(
            "DOC-FIX", "no service has failed", "What else is wrong is yours to decide."
        )
    if TARGET not in found or found[TARGET].active != "active":
        raise HypermaskError("DOC-FIX", "the show is stopped", f"systemctl start {TARGET}.")
    _as_root()
    run_it(["systemctl", "reset-failed", *failed])
    again = [name for name in failed if name != SAFE]
    if not again:
        return f"forgot that {SAFE} failed"
    _must(run_it, ["systemctl", "restart", *again])
    return f"restarted {', '.join(again)}"


def start_up(run_it: Run = run) -> str:
    found = units([TARGET], run_it).get(TARGET)
    if found is None or found.enabled not in ("enabled", "enabled-runtime", "static", "alias"):
        raise HypermaskError(
            "DOC-DISABLED",
            "the show does not start with the machine",
            "hypermask doctor --fix, or systemctl enable hypermask.target.",
        )
    if not any((Path(os.environ.get("HYPERMASK_ETC") or "/etc/hypermask")).glob("*.toml")):
        raise HypermaskError(
            "DOC-MACHINE",
            "no machine is chosen: without a file in /etc/hypermask the show does not start",
            "hypermask config set machine=cart.",
        )
    return "the show starts with the machine"


def enable(run_it: Run = run) -> str:
    _as_root()
    names = [TARGET, *(name for name in unit_names() if name.endswith(".service") and name != SAFE)]
    _must(run_it, ["systemctl", "enable", *names])
    return f"enabled {TARGET} and its services"


def watchdog(root: Path = ROOT) -> str:
    """A machine that hangs is reset only by a hardware watchdog that somebody feeds."""
    states = {}
    for folder in sorted(root.glob("sys/class/watchdog/watchdog*")):
        states[folder.name] = _text(folder / "state") or "unknown"
    if not states:
        raise HypermaskError(
            "DOC-WATCHDOG-NONE",
            "the kernel has no watchdog: a machine that hangs stays so",
            "Load its module (bcm2835_wdt, iTCO_wdt; softdog as a makeshift).",
        )
    active = [name for name, state in states.items() if state == "active"]
    if not active:
        raise HypermaskError(
            "DOC-WATCHDOG",
            "a watchdog is there but not armed",
            "RuntimeWatchdogSec=20s in /etc/systemd/system.conf.d, then systemctl daemon-reexec.",
        )
    return f"{active[0]} is armed, {_text(root / f'sys/class/watchdog/{active[0]}/timeout')} s"


def clock(now_s: float | None = None) -> str:
    """Nothing of the show needs the date; who reads the log does."""
    now_s = time.time() if now_s is None else now_s
    date = time.strftime("%Y-%m-%d", time.gmtime(now_s))
    if now_s < _EARLIEST:
        raise HypermaskError(
            "DOC-CLOCK",
            f"the clock says {date}: dates in the log are wrong, nothing else",
            "date -s '2025-12-31 20:00', or connect it to a network for a moment.",
        )
    return date


def timing() -> str:
    """Whether the workers got what they asked the system for."""
    from hypermask.machine.files import load
    from hypermask.technician.crew import text
    from hypermask.workers.health import Healths
    from hypermask.workers.running import running_board

    try:
        healths = Healths(running_board()).all()
    except HypermaskError:
        return "no show is running"
    wanted = load().machine.workers
    poor = [
        name
        for name, record in healths.items()
        if getattr(wanted, name, None) is not None
        and getattr(wanted, name).priority > 0
        and "SCHED_FIFO" not in text(record["granted"])
        and text(record["state"]) != "stopped"
    ]
    if poor:
        raise HypermaskError(
            "DOC-REALTIME",
            f"no real-time priority for {', '.join(poor)}: pictures may come late",
            "LimitRTPRIO=90 in their units; a container or kernel may forbid it.",
        )
    return "every worker has its priority"


def devices() -> str:
    """What the machine's file names, and whether it is there."""
    from hypermask.technician.devices import entries

    found = [entry for entry in entries() if entry.state != "none"]
    away = [entry for entry in found if entry.state == "away" or entry.present is False]
    if away:
        words = ", ".join(f"{entry.kind} ({entry.place})" for entry in away)
        raise HypermaskError(
            "DOC-DEVICES", f"not there: {words}", "Check cable and power; hypermask device list."
        )
    return ", ".join(f"{entry.kind} {entry.state}" for entry in found)


def sound(root: Path = ROOT) -> str:
    from hypermask.machine.files import load

    table = load().machine.device("sound")
    if table is None or table.driver != "alsa":
        return "no ALSA card in this machine"
    cards = _text(root / "proc/asound/cards")
    if not cards or "no soundcards" in cards:
        raise HypermaskError(
            "DOC-SOUND", "the kernel has no sound card", "Plug the microphone in; see dmesg."
        )
    ids = [line.partition("[")[2].partition("]")[0].strip() for line in cards.splitlines()]
    return ", ".join(name for name in ids if name)


def last_fault(now_s: float | None = None) -> str:
    """What a service died of lately (`hypermask.faults`)."""
    newest = max((paths.home() / "faults").glob("*.json"), default=None)
    if newest is None:
        return "none on record"
    now_s = time.time() if now_s is None else now_s
    try:
        content = json.loads(newest.read_text("utf-8"))
        said = f"{content['unit']}: {content['how']} ({content['utc']})"
        age_s = now_s - newest.stat().st_mtime
    except (OSError, ValueError, KeyError, TypeError):
        return f"{newest.name} cannot be read"
    if 0 <= age_s <= _RECENT_S:
        last = " ".join(str(line) for line in content.get("last", [])[-1:])
        raise HypermaskError(
            "DOC-FAULT",
            f"{said}. {last}".rstrip(". "),
            f"Mend it; then remove {newest} or wait a week.",
        )
    return said


def _as_root() -> None:
    if os.geteuid() != 0:
        raise HypermaskError("DOC-ROOT", "only root may do that", "Use sudo.")


def _must(run_it: Run, command: list[str]) -> None:
    code, output = run_it(command)
    if code != 0:
        said = " ".join(output.split())[:200]
        raise HypermaskError("DOC-FIX", f"{' '.join(command[:2])} failed: {said}", "Look by hand.")


def _text(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""
