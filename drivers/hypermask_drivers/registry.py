"""From a driver's name in the configuration to its class, imported only when asked for."""

from __future__ import annotations

import difflib
from importlib import import_module

from hypermask_drivers.device import Device
from hypermask_drivers.errors import ConfigError

_DRIVERS: dict[str, dict[str, str]] = {
    "camera": {
        "sim": "hypermask_sim.devices.camera:SimCamera",
        "v4l2": "hypermask_drivers.camera.v4l2:V4l2Camera",
    },
    "projector": {
        "sim": "hypermask_sim.devices.projector:SimProjector",
        "kms": "hypermask_drivers.projector.kms:KmsProjector",
    },
    "keypad": {
        "sim": "hypermask_sim.devices.keypad:SimKeypad",
        "usb": "hypermask_drivers.keypad.usb_pad:UsbPad",
        "pcf8574": "hypermask_drivers.keypad.i2c_pads:Pcf8574Pad",
        "tca8418": "hypermask_drivers.keypad.i2c_pads:Tca8418Pad",
    },
    "pantilt": {
        "sim": "hypermask_sim.devices.pantilt:SimPanTilt",
        "ptu": "hypermask_drivers.pantilt.ptu:DirectedPerceptionPtu",
    },
    "sound": {
        "sim": "hypermask_sim.devices.sound:SimSoundIn",
        "alsa": "hypermask_drivers.sound.alsa:AlsaSoundIn",
    },
    "lamp": {
        "sim": "hypermask_sim.devices.lamp:SimLamp",
        "dlpc34xx": "hypermask_drivers.lamp.dlpc34xx:Dlpc34xxLamp",
    },
    "power": {
        "sim": "hypermask_sim.devices.power:SimPower",
        "ina219": "hypermask_drivers.power.ina2xx:Ina219",
        "ina226": "hypermask_drivers.power.ina2xx:Ina226",
    },
}


def kinds() -> tuple[str, ...]:
    """The kinds of device: camera, projector, keypad, pantilt, sound, lamp, power."""
    return tuple(_DRIVERS)


def names(kind: str) -> tuple[str, ...]:
    """The drivers known for one kind of device."""
    return tuple(_DRIVERS[kind])


def driver_class(kind: str, name: str) -> type[Device]:
    """The class of a driver. Raises `ConfigError` DRV-NAME for an unknown name."""
    try:
        target = _DRIVERS[kind][name]
    except KeyError:
        known = list(_DRIVERS.get(kind, _DRIVERS))
        near = difflib.get_close_matches(name if kind in _DRIVERS else kind, known, n=1)
        hint = f"Did you mean '{near[0]}'?" if near else f"Known: {', '.join(known)}."
        raise ConfigError("DRV-NAME", f"there is no {kind} driver '{name}'", hint) from None
    module_name, class_name = target.split(":")
    cls = getattr(import_module(module_name), class_name)
    assert isinstance(cls, type) and issubclass(cls, Device)
    return cls
