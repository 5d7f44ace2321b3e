"""The machine file: one TOML table for each device and for each part of the show."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from hypermask.config import Settings
from hypermask.loudspeaker.settings import Loudspeaker, Microphone
from hypermask.neck.settings import NeckSettings
from hypermask.stage.settings import StageSettings
from hypermask.stream.settings import StreamSettings
from hypermask.voice.settings import VoiceSettings

DEVICES = ("camera", "projector", "keypad", "sound", "pantilt", "lamp", "power")
"""The tables that describe a device; a machine without such a table has no such device."""
WORKERS = ("tracker", "voice", "stage", "pantilt", "show", "dresser")

Degrees = Annotated[float, Field(ge=-180, le=180)]
Coefficient = Annotated[float, Field(ge=-1, le=1)]
Metres = Annotated[float, Field(ge=-20, le=20)]


class DeviceTable(Settings):
    """driver: a name of `hypermask_drivers.registry`; the other keys are that driver's own."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    driver: str

    @property
    def own(self) -> dict[str, Any]:
        """The driver's own settings, not yet looked at."""
        return dict(self.__pydantic_extra__ or {})


class CameraOptics(Settings):
    """Pinhole of the camera by its factory calibration. centre_px: None is the picture's middle."""

    focal_px: float = Field(900.0, ge=10, le=50000)
    width: int = Field(1280, ge=16, le=8192)
    height: int = Field(800, ge=16, le=8192)
    centre_px: tuple[float, float] | None = None


class ProjectorOptics(Settings):
    """The projector by its data sheet and a tape measure, used until somebody calibrates.

    centre_px: principal point; None is the middle of the picture's lower edge (lens shift).
    position_m: in the camera frame. attitude_deg: roll about z, pitch about x, yaw about y.

    mapping "fixed": a fisheye lens behind the screen. k: its coefficients (Kannala and Brandt);
    position_m: its centre in the mask frame; centre_px: None is the picture's middle.
    """

    focal_px: float = Field(1920.0, ge=10, le=50000)
    width: int = Field(1280, ge=16, le=8192)
    height: int = Field(720, ge=16, le=8192)
    centre_px: tuple[float, float] | None = None
    position_m: tuple[Metres, Metres, Metres] = (0.15, 0.0, 0.0)
    attitude_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    k: tuple[Coefficient, Coefficient, Coefficient, Coefficient] = (0.0, 0.0, 0.0, 0.0)


class Optics(Settings):
    camera: CameraOptics = CameraOptics()
    projector: ProjectorOptics = ProjectorOptics()


class TrackingSettings(Settings):
    prediction: Literal["default", "kalman", "off"] = "default"


class WorkerSettings(Settings):
    """priority: of SCHED_FIFO, 0 for none; nice: where the priority is 0. affinity: processors,
    empty for all. watchdog_s: without work for so long the worker counts as hung (the unit's
    WatchdogSec is made from it; 0 for none)."""

    priority: int = Field(0, ge=0, le=90)
    nice: int = Field(0, ge=-20, le=19)
    affinity: tuple[Annotated[int, Field(ge=0, le=1023)], ...] = ()
    lock_memory: bool = True
    watchdog_s: float = Field(5.0, ge=0, le=3600)


class Workers(Settings):
    """`[workers.NAME]`: see `WorkerSettings`."""

    tracker: WorkerSettings = WorkerSettings(priority=50)
    voice: WorkerSettings = WorkerSettings(priority=30)
    stage: WorkerSettings = WorkerSettings(priority=40)
    pantilt: WorkerSettings = WorkerSettings(priority=20)
    show: WorkerSettings = WorkerSettings(priority=10)
    dresser: WorkerSettings = WorkerSettings(nice=10, lock_memory=False, watchdog_s=60.0)


class MachineSettings(Settings):
    """The whole file. mask: a folder with mask.toml, or the name of one in configs/masks. show: a
    name in the user's shows or in configs/shows, or a path. scenario: of the simulated devices,
    a name in configs/scenarios or a path.

    mapping: "fixed" for a mask that is fixed to the projector. microphone, loudspeaker: the ALSA
    side of the voice's way to the loudspeaker.
    """

    version: Literal[1]
    name: str = Field(min_length=1, max_length=64)
    mask: str = "reference"
    show: str = "default"
    mapping: Literal["procam", "planar", "planar_projective", "fixed"] = "procam"
    scenario: str = ""
    camera: DeviceTable | None = None
    projector: DeviceTable | None = None
    keypad: DeviceTable | None = None
    sound: DeviceTable | None = None
    pantilt: DeviceTable | None = None
    lamp: DeviceTable | None = None
    power: DeviceTable | None = None
    optics: Optics = Optics()
    tracking: TrackingSettings = TrackingSettings()
    voice: VoiceSettings = VoiceSettings()
    microphone: Microphone = Microphone()
    loudspeaker: Loudspeaker = Loudspeaker()
    stage: StageSettings = StageSettings()
    neck: NeckSettings = NeckSettings()
    stream: StreamSettings = StreamSettings()
    workers: Workers = Workers()

    def device(self, kind: str) -> DeviceTable | None:
        """The table of one kind of device, None in a machine without it."""
        table: DeviceTable | None = getattr(self, kind)
        return table
