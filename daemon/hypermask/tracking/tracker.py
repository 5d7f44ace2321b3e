"""From camera frames to the mask's pose: search, confirm, lock, and let go when in doubt.

searching   the whole frame is read; a labelling of the blobs makes a candidate
confirming  the candidate must be found again in the next frames, moving as a head can move
locked      only windows round the predicted LEDs are read
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.errors import DataError
from hypermask.geometry import Array, Pinhole, Pose
from hypermask.tracking.assign import AssignSettings, assign
from hypermask.tracking.blobs import (
    Blobs,
    BlobSettings,
    Image,
    centroids,
    find_blobs,
    find_blobs_in,
)
from hypermask.tracking.confirm import Candidate, ConfirmSettings
from hypermask.tracking.labels import LabelSettings, label_blobs
from hypermask.tracking.pose import (
    PoseEstimate,
    estimate_at,
    project_leds,
    solve_all,
    solve_pose,
)

if TYPE_CHECKING:
    from hypermask.tracking.motion import MotionFilter, PredictedPose


class TrackerSettings(Settings):
    """Seconds, metres, radians, pixels."""

    blobs: BlobSettings = BlobSettings()
    labels: LabelSettings = LabelSettings()
    assign: AssignSettings = AssignSettings()
    confirm: ConfirmSettings = ConfirmSettings()
    # How long a lock lives on too few LEDs before the whole frame is searched again.
    max_two_leds_s: float = Field(0.10, ge=0)
    max_blind_s: float = Field(0.06, ge=0)
    max_three_leds_s: float = Field(3.0, ge=0)
    # Frames in a row whose LEDs do not agree with each other.
    max_bad_frames: int = Field(4, ge=1)
    max_rms_px: float = Field(0.6, gt=0)
    # Five blobs that one pose explains to this need no further test.
    agreed_px: float = Field(0.25, gt=0)
    # A single LED further than this from where the pose by all has it is not the LED.
    max_residual_px: float = Field(0.7, gt=0)
    min_window_px: float = Field(6.0, gt=0)
    max_window_px: float = Field(40.0, gt=0)
    # A pose this old still tells which way up the mask was.
    prior_lifetime_s: float = Field(2.0, ge=0)


@dataclass(frozen=True)
class TrackResult:
    """points: (5, 2) px, NaN where unseen; estimate: None unless locked and measured in this
    frame; searching: the whole frame was read."""

    time_s: float
    sequence: int
    locked: bool
    points: Array
    estimate: PoseEstimate | None
    searching: bool


_EDGE_PX = 12.0  # closer to the frame's edge a LED is handled with care
_Sighting = tuple[Blobs, Array, PoseEstimate | None]
"""One locked frame: the LEDs' blobs, their points (5, 2) with NaN where unseen, the pose."""


class Tracker:
    """Feed it every frame in order; it feeds the motion filter while locked.

    leds: (5, 3) metres in the mask frame, order of `LED_NAMES`.
    """

    def __init__(
        self, leds: Array, camera: Pinhole, settings: TrackerSettings, motion: MotionFilter
    ) -> None:
        self.leds = np.asarray(leds, float)
        self.camera = camera
        self.settings = settings
        self.motion = motion
        self.locked = False
        self._time = -math.inf
        self._candidate = Candidate(self.settings.confirm)
        self._peaks = np.full(len(self.leds), 255.0)
        self._widths = np.full(len(self.leds), 1.5)
        self._inside: Array = np.array(camera.size, float) - 1 - _EDGE_PX
        self._limit: Array = np.array([*camera.size, *camera.size], float)
        self._last_pose: Pose | None = None
        self._last_seen = self._last_two = self._last_three = -math.inf
        self._bad_frames = 0

    def process(self, image: Image, time_s: float, sequence: int) -> TrackResult:
        """Track one frame (height, width) uint8 whose mid-exposure was at `time_s`.

        A frame that is not later than the one before is ignored (unseen, the lock stays); when
        time goes back by more than a second the clock was changed and tracking starts afresh.
        Raises `DataError` TRK-IMAGE for an image of the wrong type or size.
        """
        image = self._checked(image)
        if not math.isfinite(time_s):
            raise DataError(
                "TRK-TIME", f"a frame has the time {time_s}", "Check the camera's time stamps."
            )
        if time_s <= self._time:
            if self._time - time_s < 1.0:
                return self._nothing(time_s, sequence, searching=False)
            self.reset()
        self._time = time_s
        if self.locked:
            result = self._follow(image, time_s, sequence)
            if result is not None:
                return result
        return self._search(image, time_s, sequence)

    def reset(self) -> None:
        """Forget the mask; the next frame is searched as a whole."""
        self._release()
        self._time = -math.inf
        self._last_pose = None
        self.motion.reset()

    # Locked ---------------------------------------------------------------------------------

    def _follow(self, image: Image, time_s: float, sequence: int) -> TrackResult | None:
        """One locked frame; None when the lock was let go and the frame must be searched."""
        prediction = self.motion.predict(time_s)
        projected = project_leds(prediction.pose, self.leds, self.camera)
        sighting = self._all_at_once(image, prediction.pose, projected)
        if sighting is None:
            sighting = self._one_by_one(image, prediction, projected)
        blobs, points, estimate = sighting
        seen = ~np.isnan(points[:, 0])
        if not self._keeps(estimate, int(np.count_nonzero(seen)), time_s):
            self._release()
            return None
        if estimate is None:
            return TrackResult(time_s, sequence, True, points, None, False)
        self._peaks[seen] += 0.1 * (blobs.peaks[seen] - self._peaks[seen])
        self._widths[seen] += 0.1 * (blobs.widths[seen] - self._widths[seen])
        self._last_pose = estimate.pose
        self.motion.update(time_s, estimate.pose, estimate.covariance)
        return TrackResult(time_s, sequence, True, points, estimate, False)

    def _all_at_once(
        self, image: Image, start: Pose, projected: tuple[Array, Array]
    ) -> _Sighting | None:
        """The usual frame: every LED close to where it was predicted, as bright as ever, and one
        pose that explains all of them so well that nothing else need be asked."""
        points = projected[0]
        if points.min() < _EDGE_PX or (points > self._inside).any():
            return None
        noise = self.settings.blobs.noise_grey
        blobs = centroids(image, np.column_stack([points, self._widths]), noise)
        if (blobs.peaks < 0.6 * self._peaks).any() or (
            blobs.sigmas.max() > 0.15 or blobs.peaks.min() < self.settings.blobs.min_contrast_grey
        ):
            return None
        estimate = solve_all(start, projected, blobs.points, self.leds, self.camera, blobs.sigmas)
        if estimate is None or estimate.residuals_px.max() > self.settings.agreed_px:
            return None
        return blobs, blobs.points, estimate

    def _one_by_one(
        self, image: Image, prediction: PredictedPose, projected: tuple[Array, Array]
    ) -> _Sighting:
        """Look for each LED in a window as wide as the prediction is uncertain."""
        points, jacobian = projected
        spread = jacobian @ prediction.covariance @ jacobian.T
        windows = self._windows(points, spread)
        blobs, owners = find_blobs_in(
            image, windows, self._peaks, self._widths, self.settings.blobs
        )
        chosen = assign(blobs, owners, points, spread, self._peaks, self.settings.assign)
        mine = _of_leds(blobs, chosen)
        estimate = self._solve(mine.points, mine.sigmas, prediction)
        return mine, mine.points, estimate

    def _solve(
        self, points: Array, sigmas: Array, prediction: PredictedPose
    ) -> PoseEstimate | None:
        """Pose of one locked frame. A point that the pose by all does not explain (a reflection
        that touches the LED) is made NaN in `points`, and the pose is found without it."""
        count = np.count_nonzero(~np.isnan(points[:, 0]))
        if count < 2:
            return None
        estimate = solve_pose(points, self.leds, self.camera, prediction, sigmas)
        if estimate is None or count < 4:
            return estimate
        worst = int(np.argmax(estimate.residuals_px))
        if estimate.residuals_px[worst] <= self.settings.max_residual_px:
            return estimate
        points[np.flatnonzero(~np.isnan(points[:, 0]))[worst]] = np.nan
        return self._solve(points, sigmas, prediction)

    def _windows(self, projected: Array, spread: Array) -> NDArray[np.int64]:
        """(5, 4) windows that hold each LED with its skirt, 4 sigma of the prediction wide."""
        s = self.settings
        deviation = np.sqrt(spread.diagonal()).reshape(-1, 2)
        half = 4.0 * deviation + (3.0 * self._widths + 2.0)[:, None]
        half = np.minimum(np.maximum(half, s.min_window_px), s.max_window_px)
        windows = np.empty((len(projected), 4))
        windows[:, :2] = projected - half
        windows[:, 2:] = projected + (half + 1.0)
        bounded: NDArray[np.int64] = np.minimum(np.maximum(windows, 0.0), self._limit).astype(
            np.int64
        )
        return bounded

    def _keeps(self, estimate: PoseEstimate | None, count: int, time_s: float) -> bool:
        """Whether the lock still deserves trust after this frame."""
        s = self.settings
        if estimate is not None:
            self._last_seen = time_s
            if count >= 3:
                self._last_two = time_s
            if count >= 4:
                self._last_three = time_s
            bad = estimate.rms_px > s.max_rms_px
            self._bad_frames = self._bad_frames + 1 if bad else 0
            if not self._in_range(estimate.pose):
                return False
        else:
            self._bad_frames += count > 0
        return (
            self._bad_frames < s.max_bad_frames
            and time_s - self._last_seen <= s.max_blind_s
            and time_s - self._last_two <= s.max_two_leds_s
            and time_s - self._last_three <= s.max_three_leds_s
        )

    def _in_range(self, pose: Pose) -> bool:
        distance = float(np.linalg.norm(pose.translation))
        facing = -float(pose.rotation[:, 2] @ pose.translation) / distance
        labels = self.settings.labels
        return labels.min_distance_m < distance < labels.max_distance_m and facing > math.cos(
            math.radians(min(labels.max_tilt_deg + 8, 88))
        )

    def _release(self) -> None:
        self.locked = False
        self._candidate = Candidate(self.settings.confirm)
        self._bad_frames = 0

    # Searching and confirming ---------------------------------------------------------------

    def _search(self, image: Image, time_s: float, sequence: int) -> TrackResult:
        blobs = find_blobs(image, self.settings.blobs)
        found = label_blobs(
            blobs.points, self.leds, self.camera, self.settings.labels, self._recent_pose(time_s)
        )
        if found is None:
            return self._nothing(time_s, sequence, searching=True)
        seen = found.blobs >= 0
        mine = _of_leds(blobs, found.blobs)
        estimate = estimate_at(found.pose, mine.points, self.leds, self.camera, mine.sigmas)
        if estimate is None:
            return self._nothing(time_s, sequence, searching=True)
        self._confirm(time_s, estimate, int(np.count_nonzero(seen)))
        if not self.locked:
            return TrackResult(time_s, sequence, False, mine.points, None, True)
        self._peaks = np.where(seen, mine.peaks, 255.0)
        self._widths = np.where(seen, mine.widths, np.nanmedian(mine.widths))
        return TrackResult(time_s, sequence, True, mine.points, estimate, True)

    def _recent_pose(self, time_s: float) -> Pose | None:
        """The latest pose, sighted or locked, while it still tells something."""
        lifetime, candidate = self.settings.prior_lifetime_s, self._candidate
        if candidate.times and time_s - candidate.times[-1] <= lifetime:
            return candidate.estimates[-1].pose
        if time_s - self._last_seen <= lifetime:
            return self._last_pose
        return None

    def _confirm(self, time_s: float, estimate: PoseEstimate, count: int) -> None:
        """Take a sighting; lock when enough in a row are believed."""
        candidate = self._candidate
        if not candidate.believed(time_s, estimate, complete=count == len(self.leds)):
            return
        self.motion.reset()
        for when, sighting in zip(candidate.times, candidate.estimates, strict=True):
            self.motion.update(when, sighting.pose, sighting.covariance)
        self._release()
        self.locked = True
        self._last_pose = estimate.pose
        self._last_seen = self._last_two = self._last_three = time_s

    def _checked(self, image: Image) -> Image:
        width, height = self.camera.size
        good = isinstance(image, np.ndarray) and image.dtype == np.uint8
        if not good or image.shape != (height, width):
            got = (
                f"{image.shape} {image.dtype}"
                if isinstance(image, np.ndarray)
                else type(image).__name__
            )
            raise DataError(
                "TRK-IMAGE",
                f"the tracker got an image of {got}, not ({height}, {width}) uint8",
                "Set the camera's size and 8-bit grey format as the calibration has them.",
            )
        return np.ascontiguousarray(image)

    def _nothing(self, time_s: float, sequence: int, searching: bool) -> TrackResult:
        points = np.full((len(self.leds), 2), np.nan)
        return TrackResult(time_s, sequence, self.locked, points, None, searching)


def _of_leds(blobs: Blobs, chosen: NDArray[np.int64]) -> Blobs:
    """The chosen blobs (5,), in the LEDs' order, NaN where none was chosen."""
    seen = chosen >= 0
    mine = Blobs(np.full((len(chosen), 2), np.nan), *np.full((3, len(chosen)), np.nan))
    for own, values in zip(mine, blobs, strict=True):
        own[seen] = values[chosen[seen]]
    return mine
