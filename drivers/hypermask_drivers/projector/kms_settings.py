"""What can be set about a projector on a video connector."""

from __future__ import annotations

from pydantic import Field, field_validator

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.projector.drm_modes import parse
from hypermask_drivers.settings import Settings


class KmsSettings(Settings):
    """What is asked of the projector.

    card: /dev/dri/by-path/...-card, None for the first with a display. connector: as in
    /sys/class/drm ("HDMI-A-1"). mode: "1280x720", "1280x720@60" or a modeline, None for the
    display's preferred one. force: give the signal also while no display answers. lag_ms: from the
    flip to the first line's light, the projector's own delay. brightness, gamma: the card's table.
    silence_console: keep the kernel's text off the projector.
    """

    card: str | None = None
    connector: str | None = None
    mode: str | None = None
    force: bool = False
    lag_ms: float = Field(default=17.0, ge=0)
    brightness: float = Field(default=1.0, ge=0, le=1)
    gamma: float = Field(default=1.0, gt=0, le=4)
    silence_console: bool = True

    @field_validator("mode")
    @classmethod
    def _a_mode(cls, text: str | None) -> str | None:
        """Here, so that `config check` finds it and not the stage when it starts."""
        try:
            if text is not None:
                parse(text)
        except ConfigError as error:
            raise ValueError(f"{error.what}. {error.remedy}") from None
        return text
