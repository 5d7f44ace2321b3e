"""The stage worker: the blackboard in, light on the mask out. It never waits for another worker."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from hypermask.blackboard import Record
from hypermask.geometry import Array, Pose
from hypermask.loudspeaker.offset import LipSyncMeter
from hypermask.loudspeaker.settings import Loudspeaker
from hypermask.mask import Mask
from hypermask.show.scene import (
    USUAL_AROUSAL,
    brightness_at,
    characters_at,
    intensity,
    life_of,
    units_at,
)
from hypermask.stage.mapping import (
    Mapping,
    PlanarCalibration,
    PlanarMapping,
    ProCamCalibration,
    ProCamMapping,
)
from hypermask.stage.marks import cross_of, marks_of
from hypermask.stage.marks import lit as overlay_lit
from hypermask.stage.renderer import DrawItem, StageRenderer
from hypermask.stage.scene import MaskFade, live_mouth
from hypermask.stage.settings import StageSettings
from hypermask.tracking.motion import predict as predict_motion
from hypermask.tracking.motion_model import MotionParameters
from hypermask.tracking.paper import predict_points
from hypermask.workers.board import KEPT, PACE, Board
from hypermask.workers.cast import Cast

if TYPE_CHECKING:
    from hypermask.stage.overlay import Overlay

_FAINT = (0.3, 0.3, 0.3)
_AROUSAL_S = 0.4
"""In about this time an expression follows the voice's arousal."""
FURTHEST_S = 0.15
"""How far ahead of the last measurement image points are predicted."""


@dataclass(frozen=True)
class Picture:
    """What one frame shows. matrix: (3, 4) projector_from_mask, or None for black;
    measured_s: mid-exposure of the newest measurement that the prediction used; heard_s: the
    moment of the sound that shaped the mouth; overlay: drawn in place of the face."""

    light_s: float
    matrix: Array | None
    items: tuple[DrawItem, ...]
    brightness: float
    measured_s: float | None
    heard_s: float | None = None
    overlay: Record | None = None

    @property
    def mouth_lag_s(self) -> float | None:
        """From the sound that shaped the mouth to its light."""
        return None if self.heard_s is None else self.light_s - self.heard_s

    @property
    def lead_s(self) -> float | None:
        """From the measurement to the light, measured, not assumed."""
        return None if self.measured_s is None else self.light_s - self.measured_s


class TrackReader:
    """Predicts from the newest track record; the mapping asks it at the latch."""

    tracks = True

    def __init__(
        self, board: Board, prediction: str, models: MotionParameters | None = None
    ) -> None:
        self._board = board
        self._models = models
        self._prediction = prediction
        self.track: Record | None = None

    def refresh(self) -> Record | None:
        """Latch the newest record for the coming frame."""
        self.track = self._board.track.latest()
        return self.track

    def seen_s(self, now_s: float) -> float | None:
        """When the mask was last seen, by the latched record."""
        seen_s = -np.inf if self.track is None else float(self.track["seen_s"])
        return seen_s if np.isfinite(seen_s) else None

    def pose(self, time_s: float) -> Pose | None:
        """camera_from_mask at `time_s`, None before the first measurement."""
        if self.track is None or not self.track["motion"]["samples"]:
            return None
        return predict_motion(self.track["motion"], time_s, self._prediction, self._models).pose

    def points(self, time_s: float) -> Array | None:
        """The five LEDs' image points (5, 2) at `time_s` by the paper's filter."""
        if self.track is None or not self.track["points"]["samples"]:
            return None
        # Points that were not seen again are not followed for ever.
        time_s = min(time_s, float(self.track["seen_s"]) + FURTHEST_S)
        mode = "off" if self._prediction == "off" else "default"
        return predict_points(self.track["points"], time_s, mode)


class ScreenReader(TrackReader):
    """For a screen that is fixed to its projector: always there, nothing to track."""

    tracks = False

    def refresh(self) -> Record | None:
        return None

    def seen_s(self, now_s: float) -> float | None:
        return now_s


def is_fixed(calibration: object) -> bool:
    """Whether it is of a screen that is fixed to its projector (`calibration.fixed.Fixed`); told by
    what it can, as its module is not needed elsewhere and the stage starts first."""
    return hasattr(calibration, "density")


def renderer_for(
    calibration: object,
    context: moderngl.Context,
    size: tuple[int, int],
    mask: Mask,
    settings: StageSettings,
) -> StageRenderer:
    """The renderer that belongs to a calibration, for framebuffers of `size` (width, height)."""
    if is_fixed(calibration):
        from hypermask.stage.screen import ScreenRenderer

        return ScreenRenderer(context, size, mask, calibration, settings)  # type: ignore[arg-type]
    return StageRenderer(context, size, mask, settings)


def reader_for(
    calibration: object, board: Board, prediction: str, models: MotionParameters | None = None
) -> TrackReader:
    reader = ScreenReader if is_fixed(calibration) else TrackReader
    return reader(board, prediction, models)


def mapping_for(calibration: object, mask: Mask, reader: TrackReader) -> Mapping:
    """The mapping that belongs to a calibration: planar (paper), projector matrix (default) or
    fixed (Mask-bot)."""
    if is_fixed(calibration):
        from hypermask.stage.screen import ScreenMapping

        return ScreenMapping(mask)
    if hasattr(calibration, "homography"):
        planar: PlanarCalibration = calibration  # type: ignore[assignment]
        return PlanarMapping(planar, mask, reader.points)
    procam: ProCamCalibration = calibration  # type: ignore[assignment]
    return ProCamMapping(procam, reader.pose)


class StageWorker:
    """Decides at the latch what the coming frame shows, and draws it."""

    def __init__(
        self,
        renderer: StageRenderer,
        cast: Cast,
        mapping: Mapping,
        reader: TrackReader,
        board: Board,
        period_s: float,
        settings: StageSettings,
        loudspeaker: Loudspeaker | None = None,
        fade: MaskFade | None = None,
    ) -> None:
        """loudspeaker: with it, how far mouth and sound lie apart is published each second; fade:
        of the stage that this one takes over from."""
        self._renderer, self._cast = renderer, cast
        self._lip_sync = None if loudspeaker is None else LipSyncMeter(loudspeaker)
        self._lip_sync_s = -np.inf
        self._arousal_now, self._aroused_s = USUAL_AROUSAL, 0.0
        self._mapping, self._reader, self._board = mapping, reader, board
        self._overlay: Overlay | None = None  # made when it is first wanted
        self._fade = fade or MaskFade(settings)
        self._settings = settings
        self._period_s = period_s
        self.compute_s: deque[float] = deque(maxlen=KEPT)
        self._latch_s = 0.0
        self._alone: tuple[Record, float] | None = None

    def play_alone(self, scene: Record, from_s: float) -> None:
        """What to show from clock time `from_s` on when no show ever said anything."""
        self._alone = scene, from_s

    @property
    def reader(self) -> TrackReader:
        return self._reader

    def load(self, light_s: float) -> int:
        """How many characters the frame of that light is going to show, by all that is known."""
        scene = self._board.scene.latest()
        return 0 if scene is None else len(characters_at(scene, light_s))

    def latch(self, now_s: float, light_s: float) -> Picture:
        """What the frame whose light leaves at `light_s` shows, by all that is known now."""
        began = time.perf_counter()
        self._reader.refresh()
        scene, seen_s = self._board.scene.latest(), self._reader.seen_s(now_s)
        if scene is None and self._alone is not None and now_s >= self._alone[1]:
            scene = self._alone[0]
        visible = self._fade.update(now_s, seen_s)
        overlay = self._board.overlay.latest()
        if overlay_lit(overlay, now_s):
            self._latch_s = time.perf_counter() - began
            return Picture(light_s, None, (), 0.0, None, None, overlay)
        if scene is None or visible <= 0:
            self._latch_s = time.perf_counter() - began
            return Picture(light_s, None, (), 0.0, None)
        matrix = self._mapping.at(light_s)
        brightness = brightness_at(scene, light_s) * visible
        sound = self._board.mouth.latest()
        mouth = self._mouth(sound, light_s)
        lit = matrix is not None and brightness > 0
        arousal = self._arousal(sound, light_s)
        items = self._items(scene, mouth, arousal, light_s) if lit else ()
        self._latch_s = time.perf_counter() - began
        heard_s = None if sound is None else float(sound["time_s"])
        measured_s = seen_s if self._reader.tracks else None
        picture = Picture(light_s, matrix, items, brightness, measured_s, heard_s)
        if self._lip_sync is not None and items:
            self._lip_sync.add(picture.mouth_lag_s)
        return picture

    def _items(
        self, scene: Record, mouth: Array, arousal: float, light_s: float
    ) -> tuple[DrawItem, ...]:
        units = np.minimum(units_at(scene, light_s) * intensity(scene, arousal), 1)
        return self._cast.items(
            characters_at(scene, light_s), units, mouth, light_s, life_of(scene)
        )

    def _arousal(self, sound: Record | None, light_s: float) -> float:
        """Of the voice, eased: a frame's light may not jump. As usual without a voice."""
        stale_s = self._settings.mouth_stale_after_s
        alive = sound is not None and light_s - float(sound["time_s"]) <= stale_s
        wanted = float(sound["arousal"]) if alive and sound is not None else USUAL_AROUSAL
        share = min(max(light_s - self._aroused_s, 0.0) / _AROUSAL_S, 1.0)
        self._arousal_now += share * (wanted - self._arousal_now)
        self._aroused_s = light_s
        return self._arousal_now

    def _mouth(self, sound: Record | None, light_s: float) -> Array:
        if sound is None:
            return np.zeros(13)
        age_s = light_s - float(sound["time_s"])
        return live_mouth(sound["parameters"], age_s, self._settings)

    def draw(
        self, framebuffer: moderngl.Framebuffer, picture: Picture, counted: bool = True
    ) -> None:
        """Draw the picture to the end; black where there is nothing to draw on.

        counted: whether its time, with that of its latch, is one of `compute_s`.
        """
        began = time.perf_counter()
        if picture.matrix is None or not picture.items:
            self._renderer.draw_black(framebuffer)
        else:
            self._renderer.draw(framebuffer, picture.matrix, picture.items, picture.brightness)
        if picture.overlay is not None:
            self._draw_overlay(framebuffer, picture.overlay)
        with framebuffer.ctx:
            framebuffer.ctx.finish()
        if picture.items and counted:
            self.compute_s.append(self._latch_s + time.perf_counter() - began)

    def _draw_overlay(self, framebuffer: moderngl.Framebuffer, overlay: Record) -> None:
        from hypermask.stage.overlay import Cross, Overlay

        if self._overlay is None:
            self._overlay = Overlay(self._renderer.context, self._renderer.frame_size)
        for x, y in marks_of(overlay):
            self._overlay.draw_cross(framebuffer, Cross((float(x), float(y)), 6.0, 0.5, _FAINT))
        cross = cross_of(overlay)
        if cross is not None:
            self._overlay.draw_cross(framebuffer, Cross(cross))

    def take_over(self, calibration: object, mask: Mask) -> bool:
        """Draw through another calibration from the next frame on; False where it belongs to
        another kind of machine."""
        bend = getattr(self._renderer, "bend", None)
        if is_fixed(calibration) != (bend is not None):
            return False
        if bend is not None:
            return bool(bend(calibration))
        self._mapping = mapping_for(calibration, mask, self._reader)
        return True

    def announce(self, flip_s: float, latch_lead_s: float) -> None:
        """Publish the pace, by which the tracker puts the camera's frames just before the latch."""
        record = np.zeros((), PACE)
        record["flip_s"], record["period_s"] = flip_s, self._period_s
        record["latch_lead_s"] = latch_lead_s
        self._board.pace.publish(record)
        if self._lip_sync is not None and flip_s - self._lip_sync_s >= 1:
            apart, self._lip_sync_s = self._lip_sync.record(flip_s), flip_s
            if apart is not None:
                self._board.lip_sync.publish(apart)
