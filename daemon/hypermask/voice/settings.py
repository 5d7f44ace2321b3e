"""How the mouth follows the voice: what may be set. Read without the network and its weights, for
every process reads the machine file."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from hypermask.config import Settings


class LoudnessSettings(Settings):
    """What counts as voice at all, and how soft a voice still moves the mouth."""

    range_db: float = Field(26.0, ge=10, le=60)  # below the usual voice the mouth hardly opens
    least_db: float = Field(-66.0, ge=-95, le=-10)  # full scale; never opens below


class LipSettings(Settings):
    attack_s: float = Field(0.008, ge=0, le=0.2)  # time constant of opening
    release_s: float = Field(0.010, ge=0, le=0.5)  # time constant of closing
    opening: float = Field(1.0, ge=0, le=2)  # how far the mouth opens at the usual level
    loudness: LoudnessSettings = LoudnessSettings()


class VoiceSettings(LipSettings):
    """How the mouth follows. "paper": a mouth each 32 ms, straight from the network."""

    mode: Literal["default", "paper"] = "default"
    lookahead_ms: Literal[0, 10, 20, 30] = Field(0)  # the mouth waits for so much more sound
