"""The first second of the stage: a face is lit before most of the program is loaded.

A stage that begins needs half a second of loading before it can move a face. If it prepared its
next start (`prepared`), it needs none of that for a face at rest: here it opens the projector,
draws the character that the scene names on the mask where it is (predicted with constant
velocity), and loads the rest of the program between the flips. Blackouts, fades and a mask that is
not seen are kept to. Where anything is not as it was prepared for, there is no overture.

Nothing here may import pydantic or OpenCV: together they take as long as all of this.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.blackboard import SharedTopic
from hypermask.services import prepared
from hypermask.show.fades import brightness_at, characters_at
from hypermask.stage.costume import Costume, read_costume
from hypermask.stage.layers import Actor, MeshLayer, Positions
from hypermask.stage.pacing import Pacer
from hypermask.stage.renderer import DrawItem, StageRenderer
from hypermask.stage.scene import MaskFade
from hypermask.workers.flipping import Flipper, Shown
from hypermask.workers.health import Health
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.clock import RealClock
from hypermask_drivers.projector import Projector

if TYPE_CHECKING:
    from hypermask.mask import Mask
    from hypermask.stage.settings import StageSettings

MODEL = "."
"""Key of the actor that lends all others its mesh and what all faces have in common."""
DRIVERS = {
    "kms": "hypermask_drivers.projector.kms:KmsProjector",
    "offscreen": "hypermask_drivers.projector.offscreen:Offscreen",
}
"""Those that need no more than their settings."""
CODE = str(Path(__file__).resolve())
"""Another version of the program lies elsewhere, and prepares anew."""
_FURTHEST_S = 0.5

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True)
class Still:
    """A picture of the overture; see `workers.stage.Picture`."""

    matrix: Array | None
    items: tuple[DrawItem, ...]
    brightness: float


class Overture:
    """Opens the projector at once. Raises what that raises, and BOARD-LAYOUT."""

    def __init__(self, ready: prepared.Prepared, report: Report) -> None:
        self._table, self._arrays = ready.table, ready.arrays
        folder = paths.run() / "board"
        self._track = SharedTopic(folder / "track", prepared.layout(self._table["track"]))
        self._scene = SharedTopic(folder / "scene", prepared.layout(self._table["scene"]))
        clock = RealClock()
        self.health = Health(folder, "stage", clock)
        self.device = self._projector(clock)
        self.projector = Kept(self.device, "projector", clock, report)
        self.device.open()  # which is black
        try:
            self._prepare(clock)
        except BaseException:
            self.device.close()  # the long way would find the projector taken
            raise

    def _prepare(self, clock: RealClock) -> None:
        self.renderer, self.dressed = self._dressed()
        settings: Any = SimpleNamespace(**self._table["stage"])
        self.fade = MaskFade(settings)
        self.fade.update(clock.now(), None)
        mode = self.device.mode
        self.pacer = Pacer(1 / mode.rate_hz)
        self._flipper = Flipper(self.projector, self, clock, self.pacer, mode.light_delay_s)

    def _projector(self, clock: RealClock) -> Projector:
        told = self._table["projector"]
        module, _, name = DRIVERS[told["driver"]].partition(":")
        cls = getattr(import_module(module), name)
        device: Projector = cls(SimpleNamespace(**told["settings"]), clock)
        return device

    def _dressed(self) -> tuple[StageRenderer, str]:
        """The renderer with one character: the one whom the scene shows most."""
        table, mode = self._table, self.device.mode
        outline = SimpleNamespace(**table["outline"])
        mask: Mask = SimpleNamespace(settings=SimpleNamespace(outline=outline))  # type: ignore[assignment]
        settings: StageSettings = SimpleNamespace(**table["stage"])  # type: ignore[assignment]
        size = (mode.width, mode.height)
        discs: Any = self._arrays["discs"]
        renderer = StageRenderer(self.device.context, size, mask, settings, discs, whole=False)
        renderer.load(MODEL, self._actor(), _costume(table["model"]))
        name = self._wanted()
        for _ in renderer.dress(name, MODEL, _costume(table["cast"][name])):
            pass
        return renderer, name

    def _actor(self) -> Actor:
        """The layers without their textures, which come as a costume."""
        arrays: Any = self._arrays
        bare = np.zeros((1, 1, 4), np.uint8)
        return Actor(
            tuple(
                MeshLayer(name, arrays[f"triangles{n}"], arrays[f"uv{n}"], bare, shaded)
                for n, (name, shaded) in enumerate(self._table["layers"])
            )
        )

    def _wanted(self) -> str:
        cast: dict[str, str] = self._table["cast"]
        scene = self._scene.latest()
        seen = [] if scene is None else characters_at(scene, RealClock().now())
        known = [(opacity, name) for name, opacity in seen if name in cast]
        return max(known)[1] if known else next(iter(cast))

    # --- what `Flipper` asks of a stage ---------------------------------------------------------

    def load(self, light_s: float) -> int:
        return 1

    def announce(self, flip_s: float, latch_lead_s: float) -> None:
        """The tracker's camera keeps its phase a little longer."""

    def latch(self, now_s: float, light_s: float) -> Still:
        """The fade-in runs by the time of the light: the first picture is not quite black."""
        track, scene = self._track.latest(), self._scene.latest()
        seen_s = float(track["seen_s"]) if track is not None else -np.inf
        visible = self.fade.update(
            light_s, seen_s + light_s - now_s if np.isfinite(seen_s) else None
        )
        if scene is None or track is None or visible <= 0 or not track["motion"]["samples"]:
            return Still(None, (), 0.0)
        places: tuple[Positions, ...] = tuple(
            self._arrays[f"places{n}"] for n in range(len(self._table["layers"]))
        )
        matrix = self._arrays["projector_from_camera"] @ pose_at(track["motion"], light_s)
        light = brightness_at(scene, light_s) * visible
        items = (DrawItem(self.dressed, places, 1.0),) if light > 0 else ()
        return Still(matrix, items, light)

    def draw(self, framebuffer: moderngl.Framebuffer, picture: Still) -> None:
        if picture.matrix is None or not picture.items:
            self.renderer.draw_black(framebuffer)
        else:
            self.renderer.draw(framebuffer, picture.matrix, picture.items, picture.brightness)
        with framebuffer.ctx:
            framebuffer.ctx.finish()

    # --------------------------------------------------------------------------------------------

    def play(self, steps: Generator[None, None, T]) -> T:
        """Flip after flip, a step of the loading after each, until all is loaded."""
        while True:
            shown: Shown[Still] | None = self._flipper.flip()
            if shown is not None:
                late_s = shown.shown_s - shown.planned_s
                self.health.worked(late_s, shown.missed, first=bool(shown.picture.items))
            self.health.device(self.projector.is_ready)
            self.health.publish(now=self.health.record["steps"] == 1)
            try:
                next(steps)
            except StopIteration as end:
                found: T = end.value
                return found


def pose_at(motion: NDArray[np.void], time_s: float) -> Array:
    """(4, 4) camera_from_mask at `time_s` from a motion record, with constant velocity."""
    ahead_s = min(max(time_s - float(motion["time_s"]), 0.0), _FURTHEST_S)
    estimate = motion["kalman"]
    move = estimate["state"] @ np.array([1.0, ahead_s])
    pose = np.eye(4)
    pose[:3, :3] = _turn(move[:3]) @ estimate["rotation"]
    pose[:3, 3] = estimate["translation"] + move[3:]
    return pose


def _turn(vector: Array) -> Array:
    """Rotation (3, 3) of a rotation vector (Rodrigues)."""
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = float(np.sqrt(x * x + y * y + z * z))
    if angle < 1e-9:
        return np.asarray(np.eye(3) + cross)
    first, second = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
    turned: Array = np.eye(3) + first * cross + second * (cross @ cross)
    return turned


def dark(device: Projector) -> None:
    """One black flip."""
    with device.context:
        device.framebuffer.clear(0.0, 0.0, 0.0, 1.0)
    device.present()


def _costume(file: str) -> Costume:
    return read_costume(Path(file))


def begin(report: Report) -> Overture | None:
    """The overture if one was prepared and still holds; None for the long way."""
    ready = prepared.read(prepared.path())
    if ready is None or not prepared.still_true(ready.table["inputs"]):
        return None
    if ready.table["code"] != CODE:
        return None
    try:
        return Overture(ready, report)
    except Exception:
        return None  # whatever it is, the long way says it
