"""What is asked of a device that is open: what it is (`facts`), and whether it works (`trial`)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hypermask.errors import DeviceError, HypermaskError
from hypermask_drivers.camera import Camera
from hypermask_drivers.clock import Clock
from hypermask_drivers.device import Device
from hypermask_drivers.keypad import Keypad
from hypermask_drivers.lamp import Lamp
from hypermask_drivers.pantilt import PanTilt
from hypermask_drivers.power import Power
from hypermask_drivers.projector import Projector
from hypermask_drivers.sound import SoundIn

CAMERA_S, SOUND_S, KEY_S, COLOUR_S, LAMP_S = 2.0, 3.0, 10.0, 1.0, 1.5
MOVE_RAD, MOVE_S, HOMING_S = math.radians(10), 8.0, 60.0
COLOURS = {"red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1), "white": (1, 1, 1)}
_IDLE_S = 0.002
Say = Callable[[str], None]


class TestFailed(HypermaskError):
    """DEV-TEST: the device is there but does not do what it should."""

    __test__ = False

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__("DEV-TEST", what, remedy)


def facts(device: Device) -> list[str]:
    """What an open device says of itself. Raises `DeviceError`."""
    return [*_facts(device), *_shortfalls(device)]


def _facts(device: Device) -> list[str]:
    if isinstance(device, Camera):
        mode = device.mode
        picture = f"{mode.width} x {mode.height} pixels, {mode.rate_hz:.2f} pictures a second"
        return [f"{picture}, exposure {mode.exposure_s * 1e3:.2f} ms"]
    if isinstance(device, Projector):
        shown = device.mode
        size = f"{shown.width} x {shown.height} pixels at {shown.rate_hz:.2f} Hz"
        return [f"{size}, light {shown.light_delay_s * 1e3:.1f} ms after the flip"]
    if isinstance(device, SoundIn):
        return [f"{device.rate_hz:.0f} samples a second"]
    if isinstance(device, PanTilt):
        return [_place(device), _limits(device)]
    if isinstance(device, Lamp):
        lamp = device.read()
        heat = "" if lamp.temperature_c is None else f", {lamp.temperature_c:.0f} degrees C"
        faults = [f"fault: {fault}" for fault in lamp.faults]
        return [f"{'on' if lamp.on else 'off'}, light {lamp.brightness:.0%}{heat}", *faults]
    if isinstance(device, Power):
        reading = device.read()
        left = "" if reading.charge is None else f", {reading.charge:.0%} left"
        return [f"{reading.voltage_v:.2f} V, {reading.current_a:.2f} A{left}: {reading.level}"]
    return ["it answers"]


def _shortfalls(device: Device) -> list[str]:
    """Differences between what was asked for and what is delivered, where a driver says so."""
    found: tuple[DeviceError, ...] = getattr(device, "shortfalls", ())
    return [str(error) for error in found]


def _place(head: PanTilt) -> str:
    state = head.read()
    pan, tilt = math.degrees(state.pan_rad), math.degrees(state.tilt_rad)
    known = "" if state.homed else "; its zero is not known yet"
    return f"pan {pan:.1f}, tilt {tilt:.1f} degrees{known}"


def _limits(head: PanTilt) -> str:
    limits = head.limits
    ranges = [
        f"{name} {math.degrees(low):.0f} to {math.degrees(high):.0f}"
        for name, (low, high) in (("pan", limits.pan_rad), ("tilt", limits.tilt_rad))
    ]
    return f"limits: {', '.join(ranges)}, {math.degrees(limits.speed_rad_s):.0f} degrees/s"


def trial(device: Device, clock: Clock, say: Say) -> None:
    """Let an open device do what it is for. Raises `TestFailed`, `DeviceError`."""
    tries: tuple[tuple[type[Device], Callable[[Any, Clock, Say], None]], ...] = (
        (Camera, _camera), (Projector, _projector), (Keypad, _keypad), (SoundIn, _sound),
        (PanTilt, _pantilt), (Lamp, _lamp), (Power, _power),
    )  # fmt: skip
    for kind, attempt in tries:
        if isinstance(device, kind):
            attempt(device, clock, say)
            return


def _camera(camera: Camera, clock: Clock, say: Say) -> None:
    first = last = None
    count, brightest, level = 0, 0, 0.0
    end_s = clock.now() + CAMERA_S
    while clock.now() < end_s:
        frame = camera.read(0.1)
        if frame is None:
            clock.sleep_until(clock.now() + _IDLE_S)
            continue
        stamp = frame.time_s, frame.sequence
        first, last = first or stamp, stamp
        count += 1
        brightest = max(brightest, int(frame.image.max()))
        level += float(frame.image.mean())
    if first is None or last is None or count < 2:
        raise TestFailed(
            f"the camera gave {count} pictures in {CAMERA_S:.0f} s",
            "Check its cable and port, and that nothing else uses it.",
        )
    rate = (last[1] - first[1]) / max(last[0] - first[0], 1e-9)
    dropped = last[1] - first[1] + 1 - count
    say(f"{count} pictures, {rate:.1f} a second, {dropped} dropped")
    say(f"mean grey {level / count:.1f}, brightest {brightest} of 255")
    if rate < 0.9 * camera.mode.rate_hz:
        raise TestFailed(
            f"the camera gives {rate:.1f} of {camera.mode.rate_hz:.1f} pictures a second",
            "Give it a port of its own, and more light or a shorter exposure.",
        )


def _projector(projector: Projector, clock: Clock, say: Say) -> None:
    for name, (red, green, blue) in {**COLOURS, "black": (0, 0, 0)}.items():
        say(f"the whole picture is {name}")
        end_s = clock.now() + (COLOUR_S if name != "black" else 0.1)
        flips = 0
        while clock.now() < end_s:
            with projector.context:
                projector.framebuffer.clear(red, green, blue, 1.0)
            clock.sleep_until(projector.present())
            flips += 1
        if flips == 0:
            raise TestFailed("no picture was shown", "Check the projector's cable and power.")


def _keypad(keypad: Keypad, clock: Clock, say: Say) -> None:
    say(f"press keys, for {KEY_S:.0f} s; enter ends it")
    end_s, pressed = clock.now() + KEY_S, 0
    while clock.now() < end_s:
        event = keypad.read(0.1)
        if event is None:
            clock.sleep_until(clock.now() + _IDLE_S)
        elif event.pressed:
            pressed += 1
            say(f"  {event.key}")
            if event.key == "enter":
                return
    if not pressed:
        raise TestFailed("no key was pressed", "Press some; check the pad's cable if you did.")


def _sound(sound: SoundIn, clock: Clock, say: Say) -> None:
    say(f"speak, for {SOUND_S:.0f} s")
    blocks = []
    end_s = clock.now() + SOUND_S
    while clock.now() < end_s:
        block = sound.read(0.1)
        if block is None:
            clock.sleep_until(clock.now() + _IDLE_S)
        else:
            blocks.append(np.asarray(block.samples, float))
    heard = np.concatenate(blocks) if blocks else np.zeros(0)
    if not heard.size:
        raise TestFailed("the microphone gave no sound", "Check its cable, and that it is free.")
    peak = float(np.max(np.abs(heard)))
    rms = float(np.sqrt(np.mean(heard**2)))
    say(f"{heard.size} samples, level {_db(rms)} dB, peak {_db(peak)} dB")
    if peak == 0:
        raise TestFailed(
            "the microphone gives digital silence", "Unmute it, and turn up its gain (alsamixer)."
        )
    if peak >= 0.999:
        say("it is overdriven: turn its gain down (alsamixer)")


def _db(value: float) -> str:
    return f"{20 * math.log10(max(value, 1e-6)):.0f}"


def _pantilt(head: PanTilt, clock: Clock, say: Say) -> None:
    if not head.read().homed:
        say("it finds its zero, through its whole range")
        head.home()
        _until(head, clock, HOMING_S, lambda: head.read().homed and not head.read().moving)
    for pan in (MOVE_RAD, -MOVE_RAD, 0.0):
        head.move(pan, 0.0, MOVE_RAD)
        _until(head, clock, MOVE_S, lambda pan=pan: _is_at(head, pan))  # type: ignore[misc]
        say(_place(head))


def _is_at(head: PanTilt, pan_rad: float) -> bool:
    state = head.read()
    low, high = head.limits.pan_rad
    return not state.moving and abs(state.pan_rad - min(max(pan_rad, low), high)) < 0.01


def _until(head: PanTilt, clock: Clock, most_s: float, there: Callable[[], bool]) -> None:
    end_s = clock.now() + most_s
    while not there():
        if clock.now() >= end_s:
            head.halt()
            raise TestFailed(
                f"the head did not come to its place within {most_s:.0f} s",
                "Look whether something blocks it, and at its power.",
            )
        clock.sleep_until(clock.now() + 0.05)


def _lamp(lamp: Lamp, clock: Clock, say: Say) -> None:
    before = lamp.read()
    lamp.set_power(True)
    try:
        for share in (0.3, 1.0):
            lamp.set_brightness(share)
            clock.sleep_until(clock.now() + LAMP_S)
            got = lamp.read()
            say(f"light {got.brightness:.0%} (told {share:.0%})")
            if abs(got.brightness - share) > 0.05:
                raise TestFailed("the lamp does not follow", "Compare full_current with its data.")
    finally:
        lamp.set_brightness(before.brightness)
        lamp.set_power(before.on)


def _power(power: Power, clock: Clock, say: Say) -> None:
    for _ in range(3):
        reading = power.read()
        say(f"{reading.voltage_v:.2f} V, {reading.current_a:.2f} A")
        clock.sleep_until(clock.now() + 0.5)
    if reading.voltage_v < 1.0:
        raise TestFailed("there is no voltage at the battery monitor", "Check its wires.")
