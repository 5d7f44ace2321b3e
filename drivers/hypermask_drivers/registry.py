"""From a driver's name in the configuration to its class, imported only when asked for."""

from __future__ import annotations

import difflib
from importlib import import_module

from hypermask_drivers.device import Device
from hypermask_drivers.errors import ConfigError
from hypermask_drivers.settings import Settings

_DRIVERS: dict[str, dict[str, str]] = {
    "camera": {
        "sim": "hypermask_sim.devices.camera:SimCamera",
        "v4l2": "hypermask_drivers.camera.v4l2:V4l2Camera",
    },
    "projector": {
        "sim": "hypermask_sim.devices.projector:SimProjector",
        "kms": "hypermask_drivers.projector.kms:KmsProjector",
        "offscreen": "hypermask_drivers.projector.offscreen:Offscreen",
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

_SETTINGS: dict[str, dict[str, str]] = {
    "camera": {"v4l2": "hypermask_drivers.camera.v4l2:V4l2Settings"},
    "projector": {
        "kms": "hypermask_drivers.projector.kms_settings:KmsSettings",
        "offscreen": "hypermask_drivers.projector.offscreen_settings:OffscreenSettings",
    },
    "keypad": {
        "usb": "hypermask_drivers.keypad.usb_pad:UsbPadSettings",
        "pcf8574": "hypermask_drivers.keypad.i2c_pads:MatrixSettings",
        "tca8418": "hypermask_drivers.keypad.i2c_pads:MatrixSettings",
    },
    "pantilt": {"ptu": "hypermask_drivers.pantilt.ptu:PtuSettings"},
    "sound": {"alsa": "hypermask_drivers.sound.alsa:AlsaSettings"},
    "lamp": {"dlpc34xx": "hypermask_drivers.lamp.dlpc34xx:Dlpc34xxSettings"},
    "power": {
        "ina219": "hypermask_drivers.power.ina2xx:Ina2xxSettings",
        "ina226": "hypermask_drivers.power.ina2xx:Ina2xxSettings",
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
    cls = _named(_target(kind, name))
    assert issubclass(cls, Device)
    return cls


def settings_class(kind: str, name: str) -> type[Settings] | None:
    """What can be set about a driver; None for a simulated one, which is told by its scenario.

    Raises `ConfigError` DRV-NAME for an unknown name.
    """
    _target(kind, name)
    target = _SETTINGS[kind].get(name)
    if target is None:
        return None
    cls = _named(target)
    assert issubclass(cls, Settings)
    return cls


def _target(kind: str, name: str) -> str:
    try:
        return _DRIVERS[kind][name]
    except KeyError:
        known = list(_DRIVERS.get(kind, _DRIVERS))
        near = difflib.get_close_matches(name if kind in _DRIVERS else kind, known, n=1)
        hint = f"Did you mean '{near[0]}'?" if near else f"Known: {', '.join(known)}."
        raise ConfigError("DRV-NAME", f"there is no {kind} driver '{name}'", hint) from None


def _named(target: str) -> type:
    module_name, class_name = target.split(":")
    cls = getattr(import_module(module_name), class_name)
    assert isinstance(cls, type)
    return cls
