"""The sound part of a machine's settings: which cards, and what is done to the voice."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from hypermask.config import Settings, parse, read_toml

CardName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,14}$")]
"""An ALSA card id, as in the brackets of /proc/asound/cards; unlike its number it stays."""
UsbPath = Annotated[str, Field(pattern=r"^\d+-\d+(\.\d+)*$")]
"""A USB socket, such as 1-1.2, as in /sys/bus/usb/devices."""


class Microphone(Settings):
    """usb: the socket it is plugged into; without it the first USB card that records is the
    microphone. rate_hz, channels: what the card is asked for; channel: which one has the voice.
    """

    card: CardName = "hypermask_mic"
    usb: UsbPath | None = None
    device: int = Field(0, ge=0, le=31)
    rate_hz: int = Field(48000, ge=8000, le=192000)
    channels: int = Field(1, ge=1, le=32)
    channel: int = Field(0, ge=0, le=31)
    format: str = Field("S16_LE", pattern=r"^(S16_LE|S24_3LE|S24_LE|S32_LE|FLOAT_LE)$")
    period_ms: float = Field(4.0, ge=1, le=50)

    @model_validator(mode="after")
    def _has_its_channel(self) -> Microphone:
        if self.channel >= self.channels:
            raise ValueError(f"there is no channel {self.channel} among {self.channels}")
        return self


class Gate(Settings):
    """Shuts the loudspeaker while nobody speaks, so that it does not howl or carry the stage."""

    on: bool = True
    threshold_db: float = Field(-46.0, ge=-70, le=20)
    attack_ms: float = Field(5.0, ge=0.01, le=1000)
    hold_ms: float = Field(200.0, ge=2, le=2000)
    decay_ms: float = Field(150.0, ge=2, le=4000)
    range_db: float = Field(-60.0, ge=-90, le=0)


class Notch(Settings):
    """Takes one frequency out: where microphone and loudspeaker begin to howl."""

    hz: float = Field(ge=20, le=8000)
    octaves: float = Field(0.05, ge=0.02, le=2)
    depth_db: float = Field(-36.0, ge=-60, le=-3)


class Limiter(Settings):
    on: bool = True
    limit_db: float = Field(-3.0, ge=-20, le=0)
    release_s: float = Field(0.1, ge=0.01, le=2)


class Loudspeaker(Settings):
    """delay_ms: from the sound at the microphone to the loudspeaker, so that the mouth, which
    takes as long until its light, meets it.
    """

    on: bool = True
    card: CardName = "hypermask_out"
    usb: UsbPath | None = None
    device: int = Field(0, ge=0, le=31)
    rate_hz: int = Field(48000, ge=8000, le=192000)
    channels: int = Field(2, ge=1, le=8)
    delay_ms: float = Field(57.0, ge=16, le=500)
    gain_db: float = Field(0.0, ge=-20, le=20)
    gate: Gate = Gate()
    notches: tuple[Notch, ...] = Field((), max_length=8)
    limiter: Limiter = Limiter()


class SoundSettings(Settings):
    microphone: Microphone = Microphone()
    loudspeaker: Loudspeaker = Loudspeaker()

    @model_validator(mode="after")
    def _two_cards_two_places(self) -> SoundSettings:
        mic, out = self.microphone, self.loudspeaker
        if (mic.card == out.card) != (mic.usb == out.usb and mic.usb is not None) and mic.usb:
            raise ValueError("one card has one name and one USB socket")
        return self


def load_sound(path: Path) -> SoundSettings:
    """The table [sound] of a machine's file. Raises `ConfigError` CFG-*."""
    table = read_toml(path).get("sound", {})
    return parse(SoundSettings, table, str(path))
