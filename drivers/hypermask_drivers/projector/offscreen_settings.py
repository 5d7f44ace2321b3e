"""What can be set about a projector without a display."""

from __future__ import annotations

from pydantic import Field

from hypermask_drivers.settings import Settings


class OffscreenSettings(Settings):
    """lag_ms: from the flip to the first line's light."""

    width: int = Field(1280, ge=16, le=8192)
    height: int = Field(720, ge=16, le=8192)
    rate_hz: float = Field(60.0, ge=1, le=2000)
    lag_ms: float = Field(17.0, ge=0, le=1000)
