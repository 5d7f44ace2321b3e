"""The tracker's process: camera frames in, the mask's motion out."""

from __future__ import annotations

from hypermask.services.loop import Loop, Quiet
from hypermask.services.rig import Rig
from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.tracker import Tracker, TrackerSettings
from hypermask.workers.tracker import Observer, TrackerWorker
from hypermask_drivers.camera import Camera
from hypermask_drivers.device import DeviceState

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
        motion = MotionFilter()
        tracker = Tracker(rig.mask.leds, rig.camera_model, TrackerSettings(), motion)
        self.worker = TrackerWorker(
            camera, tracker, motion, rig.board, rig.clock, rig.report, observer=observer
        )
        self._dropped = self._tries = 0

    def begin(self) -> None:
        """Nothing."""

    def turn(self) -> bool:
        worker = self.worker
        took = worker.step(WAIT_S)
        ready = worker.camera.device.state is DeviceState.READY
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
        if self.worker.camera.device.state is not DeviceState.READY:
            return "waits for the camera"
        return "sees the mask" if self.worker.locked else "looks for the mask"

    def stop(self) -> None:
        self.worker.camera.device.close()
