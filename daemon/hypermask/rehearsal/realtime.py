"""The show against the real clock: every worker a process of its own, flips that must be met.

This process is the stage. What the film needs is read back in the time that is left after a flip,
cut to the mask; what the judge needs is drawn when the show is over.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.geometry import homogeneous_apply
from hypermask.rehearsal import report as figures
from hypermask.rehearsal.lockstep import Flip, LockStep, read_back
from hypermask.rehearsal.processes import Crew, crew_of
from hypermask.rehearsal.run import Rehearsal, progress_bar
from hypermask.rehearsal.visitors import keep_characters
from hypermask.stage.pacing import Pacer
from hypermask.workers.board import Board
from hypermask.workers.realtime import be_realtime, freeze_garbage
from hypermask.workers.running import announced
from hypermask.workers.stage import Picture
from hypermask_drivers.clock import RealClock
from hypermask_sim.scenario import Scenario

PRIORITY = 40
READ_EVERY = 4
"""So many flips at 60 Hz for one that is read back for the film, and one for the judge."""
START_DELAY_S = 0.3
_MARGIN_PX = 4
_RESERVE_S = 0.0005

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Cut:
    """A part of a picture: pixels (h, w, 3) RGB, row 0 at the top, and its top left corner."""

    pixels: Image
    left: int
    top: int


@dataclass(frozen=True)
class ReadBack:
    """A flip whose picture was read back."""

    index: int
    flip_s: float
    picture: Picture
    shown: Cut
    caption: str


class RealTimeStage:
    """Plays a rehearsal's stage against the clock; the other workers are processes."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self._lockstep: LockStep = rehearsal.lockstep
        self.arrivals = rehearsal.arrivals
        self._cart = self._lockstep.cart
        self._clock = self._cart.clock
        self._every = max(1, round(READ_EVERY * self._cart.scenario.projector.rate_hz / 60))
        self.kept: list[ReadBack] = []
        self.judged: list[Picture] = []
        self.flips = 0
        self.leads_s: list[float] = []
        self.mouth_lags_s: list[float] = []
        self.missed_s: list[float] = []
        neck = self._cart.scenario.neck
        self.turns: list[tuple[float, float, float]] | None = [] if neck else None
        self.granted: list[str] = []
        self._read_cost_s = 0.002
        self.pacer = Pacer(1 / self._cart.scenario.projector.rate_hz)

    def play(self, end_s: float, on_flip: Any) -> None:
        """Flip after flip until clock time `end_s`."""
        lockstep, clock = self._lockstep, self._clock
        index = 0
        while clock.now() < end_s:
            flip_s = lockstep.projector.use(lambda device: device.next_flip_s())
            if flip_s is None:
                clock.sleep_until(clock.now() + 1 / self._cart.scenario.projector.rate_hz)
                continue
            # When reading back took too long, that is no cost of drawing: count from now.
            load = lockstep.stage.load(flip_s + lockstep.light_delay_s)
            latch_s = max(self.pacer.latch_s(flip_s, load), clock.now())
            clock.sleep_until(latch_s)
            lockstep.stage.announce(flip_s, flip_s - latch_s)
            picture = lockstep.stage.latch(clock.now(), flip_s + lockstep.light_delay_s)
            framebuffer = lockstep.projector.use(lambda device: device.framebuffer)
            if framebuffer is None:
                continue
            lockstep.stage.draw(framebuffer, picture)
            # Black is quick: it says nothing of what the faces will take that come back.
            self.pacer.drawn(latch_s, clock.now(), len(picture.items))
            shown_s = lockstep.projector.use(lambda device: device.present())
            if shown_s is None:
                continue
            self.flips += 1
            self._follow_head(shown_s)
            if self.pacer.flipped(flip_s, shown_s):
                self.missed_s.append(flip_s)
            late_s = shown_s - flip_s
            next_s = lockstep.projector.use(lambda device: device.next_flip_s())
            if next_s is not None:
                self.arrivals.look(picture.items, picture.light_s + late_s)
                self._keep(index, shown_s, _moved(picture, late_s), next_s)
                spare_s = self._spare_s(next_s)
                lockstep.wings.work(clock.now(), spare_s)
            on_flip(shown_s)
            index += 1

    def _follow_head(self, now_s: float) -> None:
        """Where the head is, by its own worker: for the pictures, which are made afterwards."""
        if self.turns is None:
            return
        head = self._lockstep.board.head.latest()
        if head is not None and bool(head["ready"]):
            self.turns.append((now_s, float(head["pan_rad"]), float(head["tilt_rad"])))

    def head_at(self, time_s: float) -> tuple[float, float]:
        """Pan and tilt at a clock time, for `World.neck`."""
        if not self.turns:
            return 0.0, 0.0
        times, pans, tilts = np.array(self.turns).T
        return float(np.interp(time_s, times, pans)), float(np.interp(time_s, times, tilts))

    def rehearse_costs(self) -> None:
        """Learn what drawing and reading back cost, before the first flip that counts."""
        for load, times_s in self._lockstep.drawing_times().items():
            for time_s in times_s:
                self.pacer.drawn(0.0, time_s, load)
        picture = self._lockstep.before_show()
        for _ in range(5):
            began_s = self._clock.now()
            self._read(self._lockstep.cart.projector.framebuffer, picture)
            self._read_cost_s = max(self._read_cost_s, self._clock.now() - began_s)

    def _spare_s(self, next_flip_s: float) -> float:
        """Time until the next frame must be begun."""
        load = self._lockstep.stage.load(next_flip_s + self._lockstep.light_delay_s)
        return next_flip_s - self.pacer.budget_s(load) - self._clock.now()

    def _keep(self, index: int, flip_s: float, picture: Picture, next_flip_s: float) -> None:
        """Remember flips for the judge, and read some back for the film where the time until the
        next latch allows it: flips come first."""
        if picture.lead_s is not None and picture.items:
            self.leads_s.append(picture.lead_s)
        if picture.mouth_lag_s is not None and picture.items:
            self.mouth_lags_s.append(picture.mouth_lag_s)
        turn = index % self._every
        if turn == self._every // 2:
            self.judged.append(picture)
        if turn or self._spare_s(next_flip_s) < self._read_cost_s + _RESERVE_S:
            return
        framebuffer = self._lockstep.projector.use(lambda device: device.framebuffer)
        if framebuffer is None:
            return
        began_s = self._clock.now()
        shown = self._read(framebuffer, picture)
        self.kept.append(ReadBack(index, flip_s, picture, shown, self._lockstep.caption(flip_s)))
        over_s = self._clock.now() - began_s - self._read_cost_s
        self._read_cost_s += (0.5 if over_s > 0 else 0.05) * over_s

    def _read(self, framebuffer: moderngl.Framebuffer, picture: Picture) -> Cut:
        """The part of the framebuffer that the mask can cover."""
        width, height = framebuffer.size
        box = self._box(picture, width, height)
        if box is None:
            return Cut(np.zeros((0, 0, 3), np.uint8), 0, 0)
        left, top, right, bottom = box
        with framebuffer.ctx:
            data = framebuffer.read(
                viewport=(left, height - bottom, right - left, bottom - top),
                components=4,
            )
        pixels = np.frombuffer(data, np.uint8).reshape(bottom - top, right - left, 4)[::-1]
        return Cut(np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGBA2RGB), np.uint8), left, top)

    def _box(self, picture: Picture, width: int, height: int) -> tuple[int, int, int, int] | None:
        if picture.matrix is None:
            return None
        if self._lockstep.tracker is None:  # a fixed screen: its map is no matrix
            return (0, 0, width, height)
        outline = self._cart.world.mask.settings.outline
        x, y = outline.half_width_m, outline.half_height_m
        corners = [[a, b, z] for a in (-x, x) for b in (-y, y) for z in (-0.03, 0.05)]
        pixels = homogeneous_apply(picture.matrix, corners)
        low = np.floor(pixels.min(axis=0)).astype(int) - _MARGIN_PX
        high = np.ceil(pixels.max(axis=0)).astype(int) + _MARGIN_PX
        left, top = (int(v) for v in np.maximum(low, 0))
        right, bottom = (int(v) for v in np.minimum(high, [width, height]))
        return None if right <= left or bottom <= top else (left, top, right, bottom)


def play_realtime(scenario: Scenario, out: Path, pictures: bool, quiet: bool) -> dict[str, Any]:
    """`hypermask rehearse --realtime`: play, then judge what was kept, and write the report."""
    # Software GL draws steadier without threads of its own where the other workers need the cores.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    with tempfile.TemporaryDirectory(prefix="hypermask-", dir=_memory()) as folder:
        board = Path(folder)
        crew = Crew(scenario, board)
        # First what can be wrong with the scenario: one message from here, none from the workers.
        rehearsal = Rehearsal(scenario, clock=RealClock(), board=Board.shared(board))
        _ = rehearsal.world.voice
        try:
            crew.start()
            stage = RealTimeStage(rehearsal)
            with announced(board):
                told = _play(crew, rehearsal, stage, quiet)
            keep_characters(board, out)
        finally:
            crew.kill()
    if stage.turns is not None:
        rehearsal.world.neck = stage.head_at
    taker = rehearsal.pictures(out) if pictures else None
    try:
        with progress_bar(quiet) as progress:
            task = progress.add_task("judging", total=len(stage.kept) + len(stage.judged))
            for flip in stage.kept:
                _look(rehearsal, flip, taker)
                progress.advance(task)
            for picture in stage.judged:
                # Drawn now, with the matrix, the light and the moment that it had in the show.
                probe = read_back(rehearsal.lockstep.draw_probe(picture))
                rehearsal.measured.append(rehearsal.judge.examine(probe, picture.light_s))
                progress.advance(task)
        rehearsal.measured.sort(key=lambda frame: frame.time_s)
        report = _report(rehearsal, stage, told)
        figures.write_json(out / "report.json", report)
        if taker is not None:
            rehearsal.finish(taker, out, report)
    except BaseException:
        if taker is not None:
            taker.abandon()
        raise
    finally:
        rehearsal.close()
    return report


def _play(
    crew: Crew, rehearsal: Rehearsal, stage: RealTimeStage, quiet: bool
) -> dict[str, dict[str, Any]]:
    world, clock = rehearsal.world, rehearsal.lockstep.cart.clock
    rehearsal.lockstep.warm_up()
    freeze_garbage()
    stage.granted = be_realtime(PRIORITY)
    stage.rehearse_costs()
    world.origin_s = clock.now() + START_DELAY_S
    crew.begin(world.origin_s)
    clock.sleep_until(world.origin_s)
    with progress_bar(quiet) as progress:
        task = progress.add_task(rehearsal.scenario.name, total=world.duration_s)
        stage.play(
            world.origin_s + world.duration_s,
            lambda now_s: progress.update(task, completed=now_s - world.origin_s),
        )
    return crew.finish()


def _look(rehearsal: Rehearsal, flip: ReadBack, taker: Any) -> None:
    shown = whole(flip.shown, rehearsal.world.projector.size)
    if rehearsal.lockstep.test_only:
        rehearsal.measured.append(rehearsal.judge.examine(shown, flip.picture.light_s))
    if taker is not None:
        taker.take(Flip(flip.index, flip.flip_s, flip.picture, shown, shown), None, flip.caption)


def whole(cut: Cut, size: tuple[int, int]) -> Image:
    """The whole picture (h, w, 3) of which `cut` was kept, black outside it."""
    picture = np.zeros((size[1], size[0], 3), np.uint8)
    height, width = cut.pixels.shape[:2]
    picture[cut.top : cut.top + height, cut.left : cut.left + width] = cut.pixels
    return picture


def _moved(picture: Picture, late_s: float) -> Picture:
    """The picture with the time at which its light really left."""
    return replace(picture, light_s=picture.light_s + late_s)


def _report(
    rehearsal: Rehearsal, stage: RealTimeStage, told: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    for kind in crew_of(rehearsal.scenario):
        if kind not in told:
            rehearsal.journal(
                rehearsal.world.origin_s,
                "WRK-LOST",
                f"WRK-LOST: the {kind} process died during the show. Look at its messages.",
            )
    # Without a tracker nothing was tracked; one that died tells nothing.
    seen = rehearsal.lockstep.observer.summary() if rehearsal.lockstep.tracker is None else None
    tracker = {"tracking": seen, "compute_s": [], "latency_s": [], "arrival_s": []} | told.get(
        "tracker", {}
    )
    voice = {"history": [], "compute_s": []} | told.get("voice", {})
    dresser = {"compute_s": []} | told.get("dresser", {})
    head = {"head": None} | told.get("pantilt", {})
    for worker in told.values():
        for event in worker["events"]:
            rehearsal.journal(event.time_s, event.code, event.text)
    rehearsal.leads_s = stage.leads_s
    rehearsal.mouth_lags_s = stage.mouth_lags_s
    report = rehearsal.report(tracker["tracking"], voice["history"])
    missed = rehearsal.lockstep.missed_flips
    report |= {
        "mode": "realtime",
        "head": head["head"],
        "frames": stage.flips,
        "missed_flips": missed,
        "missed_flips_at_s": [
            round(time_s - rehearsal.world.origin_s, 3) for time_s in stage.missed_s
        ],
        "flips_on_time": round(stage.flips / max(stage.flips + missed, 1), 6),
        "compute_ms": {
            "clock": "real",
            "tracking": figures.spread(tracker["compute_s"], 1e3),
            "stage": figures.spread(rehearsal.lockstep.stage.compute_s, 1e3),
            "voice": figures.spread(voice["compute_s"], 1e3),
            "dresser": figures.spread(dresser["compute_s"], 1e3),
        },
        "exposure_to_blackboard_ms": figures.spread(tracker["latency_s"], 1e3),
        "arrival_to_blackboard_ms": figures.spread(tracker["arrival_s"], 1e3),
        "granted": {kind: worker["granted"] for kind, worker in told.items()}
        | {"stage": stage.granted},
    }
    return report


def _memory() -> str | None:
    """A folder in memory, so that the blackboard is never written to a disk."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
