"""Every test of the appliance is a step of its trial's report, build/appliance-report."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from theatre import Theatre
from virtual_show import VirtualShow
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from hypermask_sim.appliance.image import Image, build
from hypermask_sim.appliance.report import Part, Step

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "build/appliance-report"
DEBS = ROOT / "build/deb"
NEXT_DEBS = ROOT / "build/appliance/next"
TOOLS = ("qemu-system-x86_64", "qemu-img", "mmdebstrap", "mkfs.ext4", "dpkg-deb")
BREAKS = ("test_faults_in_qemu", "test_video_in_qemu")
"""These files one after the other, the rest beside them: both rows take about the same time."""
_PARTS = pytest.StashKey[dict[str, Part]]()
_PART = pytest.StashKey[Part]()
_STEP = pytest.StashKey[Step]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    why = ""
    if os.geteuid() != 0:
        why = "building the disk needs root"
    elif missing := [tool for tool in TOOLS if shutil.which(tool) is None]:
        why = f"needs {', '.join(missing)}"
    # Last: their machine gives way to the other one, and would take twice as long beside its boot.
    items.sort(key=lambda item: Path(item.path).stem == "test_power_cuts_in_qemu")
    for item in items:
        if why and item.get_closest_marker("appliance"):
            item.add_marker(pytest.mark.skip(reason=why))


class TwoRows(LoadScopeScheduling):
    """A machine for each processor."""

    def _split_scope(self, nodeid: str) -> str:
        return "breaks" if Path(nodeid.split("::")[0]).stem in BREAKS else "plays"


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> TwoRows:
    return TwoRows(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    if item.get_closest_marker("appliance") is None:
        return (yield)
    name = Path(item.path).stem
    part = item.config.stash.setdefault(_PARTS, {}).get(name) or Part(FOLDER, name)
    item.config.stash[_PARTS][name] = part
    doc = (getattr(item, "obj", None) and item.obj.__doc__) or ""
    title = doc.strip().splitlines()[0] if doc else item.name.removeprefix("test_")
    item.stash[_PART] = part
    item.stash[_STEP] = part.begin(item.name, title.replace("_", " "))
    result = yield
    part.write()
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report = yield
    step = item.stash.get(_STEP, None)
    if step is not None:
        item.failed = getattr(item, "failed", False) or report.outcome != "passed"  # type: ignore[attr-defined]
        step.seconds += report.duration
        if report.outcome == "failed" or (
            report.outcome == "skipped" and report.when != "teardown"
        ):
            step.outcome = report.outcome
            step.why = str(report.longrepr)[-6000:]
        elif report.when == "call" and step.outcome == "running":
            step.outcome = "passed"
    return report


class Record:
    """What a test adds to its step of the report."""

    def __init__(self, part: Part, step: Step) -> None:
        self._part, self._step = part, step

    def picture(self, picture: NDArray[np.uint8], caption: str) -> None:
        self._part.picture(self._step, picture, caption)

    def note(self, text: str) -> None:
        self._step.notes.append(text)
        self._part.write()

    def log(self, text: str) -> None:
        self._step.log += text


@pytest.fixture
def record(request: pytest.FixtureRequest) -> Record:
    return Record(request.node.stash[_PART], request.node.stash[_STEP])


@pytest.fixture(scope="session")
def disk() -> Image:
    """The appliance's disk: a Debian with the packages of `make deb` in it, built where it is not
    there (`make appliance`)."""
    debs = sorted(DEBS.glob("*.deb"))
    if not debs:
        pytest.fail("there are no packages in build/deb: run make deb")
    return build(ROOT / "build/appliance", debs)


@pytest.fixture(scope="module")
def theatre(disk: Image, request: pytest.FixtureRequest) -> Iterator[Theatre]:
    theatre = Theatre(disk, ROOT / "build/appliance" / Path(request.path).stem)
    yield theatre
    theatre.close()


@pytest.fixture
def show(theatre: Theatre) -> VirtualShow:
    return theatre.playing()


@pytest.fixture(autouse=True)
def _kept(request: pytest.FixtureRequest) -> Iterator[None]:
    """The picture and the journal at the end of each step of a show; a step that failed leaves a
    machine that is not trusted."""
    if "theatre" not in request.fixturenames:
        yield
        return
    theatre: Theatre = request.getfixturevalue("theatre")
    record: Record = request.getfixturevalue("record")
    yield
    show = theatre.show
    failed = getattr(request.node, "failed", True)
    theatre.plays = not failed
    if show is None:
        return
    if show.cart.stumbles:
        record.note(f"the emulated processor stumbled at the start, {show.cart.stumbles} times")
    try:
        record.picture(show.picture(), "at the end of the step")
        record.log(show.journal(400 if failed else 60))
    except Exception as error:
        theatre.plays = False
        record.log(f"the machine does not answer: {error}")


@pytest.fixture(scope="session")
def next_debs() -> list[Path]:
    """The same packages with a higher version."""
    debs = sorted(NEXT_DEBS.glob("*.deb"))
    if not debs:
        pytest.fail("there is no next version in build/appliance/next: run make appliance")
    return debs
