"""The tracker's process: camera frames in, the mask's motion out."""

from __future__ import annotations

from hypermask.geometry import Pinhole
from hypermask.services.loop import Loop, Quiet
from hypermask.services.rig import Rig
from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.tracker import Tracker, TrackerSettings
from hypermask.workers.tracker import Observer, TrackerWorker
from hypermask_drivers.camera import Camera

WAIT_S = 0.1
IDLE_S = 0.02


def build(rig: Rig, observer: Observer | None = None) -> Loop:
    camera = rig.device("camera")
    if camera is None:
        return Quiet("no camera in this machine")
    assert isinstance(camera, Camera)
    return TrackerLoop(rig, camera, observer)


class TrackerLoop:
    def __init__(self, rig: Rig, camera: Camera, observer: Observer | None) -> None:
        self._clock, self._health = rig.clock, rig.health
        self._rig, self._camera = rig, camera
        self._model, self._tracked = rig.camera_model, MotionFilter()
        self.worker = TrackerWorker(
            camera,
            self._tracker(),
            self._tracked,
            rig.board,
            rig.clock,
            rig.report,
            observer=observer,
        )
        self._dropped = self._tries = 0

    def _tracker(self) -> Tracker:
        return Tracker(self._rig.mask.leds, self._model, TrackerSettings(), self._tracked)

    def _fit(self) -> None:
        """For a camera of another size the optics are scaled, and it is said."""
        mode = self.worker.camera.use(lambda camera: camera.mode)
        if mode is None or (mode.width, mode.height) == self._model.size:
            return
        size = (mode.width, mode.height)
        measured = self._model.size
        self._model = scaled(self._rig.camera_model, size)
        self.worker.tracker = self._tracker()
        self._rig.report(
            self._clock.now(),
            "CAM-OPTICS",
            f"CAM-OPTICS: the camera delivers {size[0]} x {size[1]}, its optics were measured at "
            f"{measured[0]} x {measured[1]}. They are scaled; measure them at the size in use.",
        )

    def begin(self) -> None:
        """Nothing."""

    def turn(self) -> bool:
        worker = self.worker
        self._fit()
        took = worker.step(WAIT_S)
        ready = worker.camera.is_ready
        self._health.device(ready)
        if took:
            dropped = worker.dropped
            self._health.worked(worker.latency_s[-1], dropped - self._dropped)
            self._dropped = dropped
            return True
        if not ready:
            self._clock.sleep_until(self._clock.now() + IDLE_S)
        tried, self._tries = worker.camera.tries != self._tries, worker.camera.tries
        return tried

    def status(self) -> str:
        if not self.worker.camera.is_ready:
            return "waits for the camera"
        return "sees the mask" if self.worker.locked else "looks for the mask"

    def stop(self) -> None:
        self._camera.close()


def scaled(model: Pinhole, size: tuple[int, int]) -> Pinhole:
    """The same lens on a picture of another size, its middle kept and its width filled."""
    factor = size[0] / model.size[0]
    matrix = model.matrix.copy()
    matrix[0, 0], matrix[1, 1] = factor * matrix[0, 0], factor * matrix[1, 1]
    for axis in (0, 1):
        middle = (model.size[axis] - 1) / 2
        matrix[axis, 2] = (size[axis] - 1) / 2 + factor * (model.matrix[axis, 2] - middle)
    return Pinhole(matrix, size)
