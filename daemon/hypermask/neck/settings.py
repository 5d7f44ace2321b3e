"""How the neck may move: what may be set."""

from __future__ import annotations

from pydantic import Field

from hypermask.config import Settings
from hypermask.neck.record import SILENT_AFTER_S


class NeckSettings(Settings):
    """pan_deg, tilt_deg: soft limits, inside the unit's. silence_s: without a word from the show,
    or without a turn of its own, for so long the head halts; park_after_s later it goes to
    park_deg (pan, tilt). lookahead_s: how far ahead of now the unit's targets are."""

    pan_deg: tuple[float, float] = (-60.0, 60.0)
    tilt_deg: tuple[float, float] = (-30.0, 25.0)
    speed_deg_s: float = Field(90.0, gt=0, le=1000)
    acceleration_deg_s2: float = Field(360.0, gt=0, le=100000)
    silence_s: float = Field(SILENT_AFTER_S, gt=0.05, le=10)
    park_after_s: float = Field(3.0, ge=0, le=3600)
    park_deg: tuple[float, float] = (0.0, 0.0)
    park_vigour: float = Field(0.3, gt=0, le=1)
    lookahead_s: float = Field(0.15, gt=0, le=0.5)
