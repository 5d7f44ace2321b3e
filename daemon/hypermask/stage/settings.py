"""What can be set about the stage."""

from __future__ import annotations

from pydantic import Field

from hypermask.config import Settings


class StageSettings(Settings):
    """Section `[stage]`.

    brightness_limit: largest light of any pixel, as a fraction of the projector's full light.
    mean_light_limit: largest mean light of a character's texture, same unit; a brighter one is
        dimmed as a whole.
    projector_gamma: the projector's light is its pixel value to this power; textures are made
        for 2.2.
    outline_soft_m: width of the soft edge, all of it inside the mask's outline.
    even_light: on a fixed screen, how much of the light's falling off towards its rim is taken
        away by dimming the middle: 0 nothing, 1 all.
    eye_hole_margin_m: added to the eye holes' radius for the black discs.
    eye_hole_soft_m: width of the discs' soft edge, outside radius and margin.
    mask_lost_after_s, fade_out_s, fade_in_s: see `scene.MaskFade`.
    mouth_stale_after_s, mouth_closing_s: see `scene.live_mouth`.
    """

    brightness_limit: float = Field(1.0, gt=0, le=1)
    mean_light_limit: float = Field(1.0, gt=0, le=1)
    projector_gamma: float = Field(2.2, ge=1, le=4)
    outline_soft_m: float = Field(0.004, gt=0, le=0.03)
    even_light: float = Field(0.5, ge=0, le=1)
    eye_hole_margin_m: float = Field(0.001, ge=0, le=0.02)
    eye_hole_soft_m: float = Field(0.0015, gt=0, le=0.01)
    mask_lost_after_s: float = Field(0.15, ge=0)
    fade_out_s: float = Field(0.2, gt=0, le=0.25)
    fade_in_s: float = Field(0.03, gt=0, le=0.06)
    mouth_stale_after_s: float = Field(0.2, ge=0)
    mouth_closing_s: float = Field(0.1, gt=0)
