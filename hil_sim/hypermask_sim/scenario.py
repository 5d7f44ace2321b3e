"""A scenario: one TOML file that says everything about a simulated show.

`extends = "other.toml"` takes the other file's tables and changes them key by key (a list replaces
the other's list). Paths are looked for beside the file that states them, then in the current
folder. `load_scenario` is the only way in for files; `Scenario()` alone is the reference cart with
a still mask and no reflections.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.keypad import KEYS
from hypermask_drivers.settings import Settings, override, parse, read_toml
from hypermask_sim.faults import FaultSettings as FaultSettings
from hypermask_sim.faults import Milliseconds, Seconds

Metres = Annotated[float, Field(ge=-20, le=20)]
Position = tuple[Metres, Metres, Metres]


def _as_tuple(value: object) -> object:
    return (value,) if isinstance(value, str) else value


Choices = Annotated[tuple[str, ...], BeforeValidator(_as_tuple), Field(min_length=1)]
"""One name or path, or several: the first that is there is taken."""


class Attitude(Settings):
    roll: float = Field(0.0, ge=-360, le=360)
    pitch: float = Field(0.0, ge=-90, le=90)
    yaw: float = Field(0.0, ge=-90, le=90)


class PerformerSettings(Settings):
    """motion: CSV path or a path of `performer.BUILT_IN`; voice: WAV path, "speech" or "none".

    position_m: rest position in the camera frame; without it, the point at `distance_m` on the ray
    through the centre of the projector's picture. attitude_deg turns the mask before the motion.
    voice_pause_s: with it the recording is heard again and again, this much silence between.
    speed: built-in paths only, 2 is twice as fast. keys: [[time in s, key name], ...].
    photos: [[time in s, picture file, name], ...]: a visitor hands in a photograph, of which a
    character of that name is made and joins the show.
    """

    motion: Choices = ("still",)
    speed: float = Field(1.0, gt=0, le=10)
    voice: Choices = ("none",)
    voice_start_s: Seconds = 0.0
    voice_pause_s: Seconds | None = None
    distance_m: float = Field(1.8, ge=0.5, le=10)
    position_m: Position | None = None
    attitude_deg: Attitude = Attitude()
    keys: tuple[tuple[Seconds, str], ...] = ()
    photos: tuple[tuple[Seconds, str, str], ...] = ()

    @model_validator(mode="after")
    def _known_keys(self) -> PerformerSettings:
        for _, key in self.keys:
            if key not in KEYS:
                raise ValueError(f"there is no key '{key}'; the keys are {', '.join(KEYS)}")
        return self


class CameraSettings(Settings):
    """available_ms: from mid-exposure until a read returns the frame. ambient: grey level of the
    infrared background at 1 ms exposure. buffers: frames kept for a slow reader. shiftable:
    whether the sensor's phase can be moved by longer or shorter blankings.
    """

    width: int = Field(1280, ge=16, le=8192)
    height: int = Field(800, ge=16, le=8192)
    rate_hz: float = Field(120.0, ge=1, le=2000)
    focal_px: float = Field(900.0, ge=10, le=50000)
    centre_px: tuple[float, float] | None = None
    exposure_ms: float = Field(1.0, gt=0, le=100)
    available_ms: Milliseconds = 9.3
    read_noise: float = Field(2.0, ge=0, le=50)
    ambient: float = Field(8.0, ge=0, le=255)
    psf_px: float = Field(1.0, gt=0.2, le=10)
    shiftable: bool = True
    phase_ms: Milliseconds = 0.0
    rate_error_ppm: float = Field(0.0, ge=-10000, le=10000)
    buffers: int = Field(4, ge=1, le=64)


class ProjectorSettings(Settings):
    """light_ms: from the flip until the first row's light leaves; half a scan comes on top.

    centre_px: principal point; without it the middle of the picture's lower edge (lens shift).
    position_m, attitude_deg: of the projector in the camera frame (x right, y down, z forward).
    readback_every: in real time only every n-th picture is read back for the judge.
    """

    width: int = Field(1280, ge=16, le=8192)
    height: int = Field(720, ge=16, le=8192)
    rate_hz: float = Field(60.0, ge=1, le=2000)
    focal_px: float = Field(1920.0, ge=10, le=50000)
    centre_px: tuple[float, float] | None = None
    position_m: Position = (0.15, 0.0, 0.0)
    attitude_deg: Attitude = Attitude()
    light_ms: Milliseconds = 17.0
    phase_ms: Milliseconds = 0.0
    rate_error_ppm: float = Field(0.0, ge=-10000, le=10000)
    readback_every: int = Field(15, ge=1, le=100000)


class LedSettings(Settings):
    """peak: grey level of the brightest pixel at 1.8 m, seen from the front, 1 ms exposure.

    diameter_mm: of the glowing disc. half_angle_deg: where the light has fallen to one half.
    """

    peak: float = Field(170.0, gt=0, le=10000)
    diameter_mm: float = Field(5.0, gt=0, le=50)
    half_angle_deg: float = Field(60.0, gt=5, lt=89)


class ReflectionSettings(Settings):
    """A bright spot at `position_m` in the camera frame.

    With `to_m` it swings between the two points once in `period_s`. peak: grey level at 1 ms
    exposure; size_px: standard deviation of its image.
    """

    position_m: Position
    to_m: Position | None = None
    period_s: float = Field(4.0, gt=0.05, le=3600)
    peak: float = Field(150.0, gt=0, le=10000)
    size_px: float = Field(1.2, gt=0.2, le=20)

    @model_validator(mode="after")
    def _before_the_camera(self) -> ReflectionSettings:
        if min(self.position_m[2], self.to_m[2] if self.to_m else 1.0) < 0.1:
            raise ValueError("a reflection must lie at least 0.1 m in front of the camera")
        return self


class MicrophoneSettings(Settings):
    """noise_db: of the room, relative to full scale. buffers: blocks kept for a slow reader."""

    rate_hz: int = Field(16000, ge=4000, le=192000)
    block_ms: float = Field(8.0, gt=0.5, le=500)
    noise_db: float = Field(-66.0, ge=-160, le=0)
    buffers: int = Field(64, ge=1, le=4096)


class LoudspeakerSettings(Settings):
    """delay_ms: from the sound at the microphone to the loudspeaker's, so that sound and mouth
    meet."""

    delay_ms: Milliseconds = 45.0


class PanTiltSettings(Settings):
    pan_deg: tuple[float, float] = (-159.0, 159.0)
    tilt_deg: tuple[float, float] = (-47.0, 31.0)
    speed_deg_s: float = Field(100.0, gt=0, le=1000)
    acceleration_deg_s2: float = Field(400.0, gt=0, le=100000)
    homing_s: Seconds = 2.0


class PowerSettings(Settings):
    capacity_ah: float = Field(12.0, gt=0, le=1000)
    current_a: float = Field(5.5, ge=0, le=500)
    charge: float = Field(1.0, ge=0, le=1)
    full_v: float = Field(13.4, gt=0, le=100)
    empty_v: float = Field(11.0, gt=0, le=100)
    resistance_ohm: float = Field(0.05, ge=0, le=10)


class ScreenSettings(Settings):
    """A Mask-bot's screen: the mask's relief, translucent, fixed to a projector behind it.

    What the builder knows: lens_m, place of the fisheye lens's centre in the mask frame; k, its
    four coefficients (Kannala and Brandt); the projector's focal_px and centre_px. How it really
    is, unknown to the show: lens_error_mm and lens_error_deg, beside its place; focal_error, a
    fraction; k_error; decentring of its elements.
    pivot_m: where the axes of the pan-tilt unit meet, in the mask frame with the head straight.
    """

    lens_m: Position = (0.0, 0.0, -0.12)
    k: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    lens_error_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lens_error_deg: Attitude = Attitude()
    focal_error: float = Field(0.0, ge=-0.2, le=0.2)
    k_error: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    decentring: tuple[float, float] = (0.0, 0.0)
    pivot_m: Position = (0.0, -0.16, -0.08)

    @model_validator(mode="after")
    def _behind(self) -> ScreenSettings:
        if self.lens_m[2] > -0.08:
            raise ValueError("the lens must lie at least 0.08 m behind the screen")
        return self


class LatencySettings(Settings):
    """What the program's own steps take in lock-step runs, where no real time passes.

    voice_ms: from a sound block's last sample until it can be read. character_ms: from a
    photograph until the character made of it can be sent to the projector's GPU.
    """

    tracking_ms: Milliseconds = 1.0
    latch_ms: Milliseconds = 3.0
    voice_ms: Milliseconds = 4.0
    character_ms: Milliseconds = 300.0


class VoiceSettings(Settings):
    mode: Literal["default", "paper"] = "default"


class TrackingSettings(Settings):
    prediction: Literal["default", "kalman", "off"] = "default"


class CalibrationSettings(Settings):
    """method: how the show is calibrated before it begins; "exact" takes the true projector,
    "stored" the calibration that is in use on this machine. file: take this calibration instead.
    A fixed screen's control points are nudged, unless it is exact or stored; operator_error_mm:
    how far from them, an axis, he takes the light to be on them.
    """

    method: Literal["click", "affine", "projective", "exact", "stored"] = "click"
    file: str | None = None
    distances_m: tuple[Annotated[float, Field(ge=0.5, le=10)], ...] = Field(
        (1.2, 1.8, 2.4), min_length=1, max_length=10
    )
    poses_per_distance: int = Field(2, ge=1, le=20)
    operator_error_px: float = Field(1.0, ge=0, le=100)
    operator_error_mm: float = Field(0.5, ge=0, le=20)


class StageSettings(Settings):
    brightness_limit: float = Field(1.0, gt=0, le=1)


class Scenario(Settings):
    """The whole file. character, show, mapping, tracking, voice, calibration and stage are for the
    show.

    duration_s: without it, the length of the motion clip, or 10 s for a built-in path.
    mask: a folder with mask.toml, or the name of one in configs/masks.
    mapping "fixed": a Mask-bot, see `screen`. neck: whether a pan-tilt unit carries the head.
    """

    name: str = "reference-cart"
    seed: int = Field(1, ge=0, le=2**31)
    duration_s: float | None = Field(None, gt=0, le=86400)
    mask: str = "reference"
    character: str = "dots"
    show: str | None = None
    mapping: Literal["procam", "planar", "planar_projective", "fixed"] = "procam"
    neck: bool = False
    performer: PerformerSettings = PerformerSettings()
    camera: CameraSettings = CameraSettings()
    projector: ProjectorSettings = ProjectorSettings()
    screen: ScreenSettings = ScreenSettings()
    leds: LedSettings = LedSettings()
    reflections: tuple[ReflectionSettings, ...] = ()
    microphone: MicrophoneSettings = MicrophoneSettings()
    loudspeaker: LoudspeakerSettings = LoudspeakerSettings()
    pantilt: PanTiltSettings = PanTiltSettings()
    power: PowerSettings = PowerSettings()
    latency: LatencySettings = LatencySettings()
    tracking: TrackingSettings = TrackingSettings()
    voice: VoiceSettings = VoiceSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    stage: StageSettings = StageSettings()
    faults: tuple[FaultSettings, ...] = ()

    def with_changes(self, assignments: list[str]) -> Scenario:
        """The same scenario with ``key.path=value`` assignments. Raises `ConfigError`."""
        data = self.model_dump(exclude_unset=True)
        return parse(Scenario, override(data, assignments), f"scenario {self.name}")

    def still(self, distance_m: float, attitude_deg: Attitude | None = None) -> Scenario:
        """The same cart with the mask held still at a distance: for calibration and yardsticks."""
        performer = self.performer.model_copy(
            update={
                "motion": ("still",),
                "distance_m": distance_m,
                "position_m": None,
                "attitude_deg": attitude_deg or Attitude(),
            }
        )
        return self.model_copy(update={"performer": performer})


def load_scenario(path: Path, assignments: list[str] | None = None) -> Scenario:
    """Read a scenario file, what it extends, and apply ``key.path=value`` assignments.

    Raises `ConfigError` (CFG-ABSENT, CFG-SYNTAX, CFG-KEY, CFG-VALUE, CFG-EXTENDS, SET-FORM).
    """
    data = _read_chain(path, ())
    if not assignments:
        return parse(Scenario, data, str(path))
    changed = override(data, assignments)
    return parse(Scenario, _anchored(changed, Path.cwd()), f"{path} with --set")


def _read_chain(path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    if path.resolve() in seen:
        raise ConfigError("CFG-EXTENDS", f"{path} extends itself", "Break the circle.")
    data = read_toml(path)
    base = data.pop("extends", None)
    if base is None:
        parse(Scenario, data, str(path))
        return _anchored(data, path.parent)
    if not isinstance(base, str):
        raise ConfigError(
            "CFG-VALUE", f"{path}: 'extends' = {base!r} is wrong", "Name one scenario file."
        )
    below = _read_chain(path.parent / base, (*seen, path.resolve()))
    merged = _merged(below, _anchored(data, path.parent))
    parse(Scenario, merged, str(path))
    return merged


def _merged(base: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in change.items():
        inner = result.get(key)
        both = isinstance(inner, dict) and isinstance(value, dict)
        result[key] = _merged(inner, value) if both else value  # type: ignore[arg-type]
    return result


def _anchored(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Make the paths absolute that are there beside the file which states them."""
    result = dict(data)
    for key in ("mask", "show", "character"):
        if key in result:
            result[key] = _anchor(result[key], folder)
    calibration = result.get("calibration")
    if isinstance(calibration, dict) and "file" in calibration:
        result["calibration"] = {**calibration, "file": _anchor(calibration["file"], folder)}
    performer = result.get("performer")
    if isinstance(performer, dict):
        found = {
            key: _anchor(performer[key], folder) for key in ("motion", "voice") if key in performer
        }
        photos = performer.get("photos")
        if isinstance(photos, list):
            found["photos"] = [_anchored_photo(photo, folder) for photo in photos]
        result["performer"] = {**performer, **found}
    return result


def _anchored_photo(photo: Any, folder: Path) -> Any:
    if not isinstance(photo, list) or len(photo) != 3:
        return photo
    return [photo[0], _anchor(photo[1], folder), photo[2]]


def _anchor(value: Any, folder: Path) -> Any:
    if isinstance(value, list | tuple):
        return [_anchor(item, folder) for item in value]
    is_path = isinstance(value, str) and ("/" in value or "." in value)
    return str((folder / value).resolve()) if is_path and (folder / value).exists() else value
