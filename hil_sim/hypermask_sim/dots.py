"""The judge's test character: smooth coloured dots at known points of the mask's surface.

Dots of one colour are at least `SAME_COLOUR_M` apart, so a dot is never taken for its twin.
Run `python -m hypermask_sim.dots configs/characters/dots [mask folder]` after a change.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.mask import Mask, load_mask
from hypermask_drivers.settings import Settings, load

Array = NDArray[np.float64]

COLOURS = {
    "red": (1, 0, 0),
    "green": (0, 1, 0),
    "blue": (0, 0, 1),
    "yellow": (1, 1, 0),
    "cyan": (0, 1, 1),
    "magenta": (1, 0, 1),
    "white": (1, 1, 1),
}
"""RGB codes: a channel is full or dark, so that the code outlives any fade."""

SAME_COLOUR_M = 0.140
TEXTURE_WIDTH = 1024

# Millimetres; x to the audience's right, y up. White and magenta share the rim with the nose.
LAYOUT_MM = {
    "forehead_far_left": ("white", -71, 105),
    "forehead_far_right": ("white", 71, 105),
    "nose": ("white", 0, -17),
    "jaw_left": ("magenta", -71, -105),
    "jaw_right": ("magenta", 71, -105),
    "forehead": ("red", 0, 98),
    "chin": ("red", 0, -97),
    "brow_left": ("green", -36, 68),
    "mouth_right": ("green", 30, -60),
    "brow_right": ("blue", 36, 68),
    "mouth_left": ("blue", -30, -60),
    "temple_left": ("yellow", -74, 22),
    "cheek_right": ("yellow", 60, -24),
    "temple_right": ("cyan", 74, 22),
    "cheek_left": ("cyan", -60, -24),
}


class DotSettings(Settings):
    name: str
    colour: str
    position_m: tuple[float, float]


class DotsSettings(Settings):
    """core_radius_m: full brightness within; rim_radius_m: dark beyond, smooth between."""

    version: int = Field(ge=1, le=1)
    core_radius_m: float = Field(ge=0)
    rim_radius_m: float = Field(gt=0)
    dot: tuple[DotSettings, ...]


@dataclass(frozen=True)
class Dots:
    """names (N,); codes (N, 3) RGB 0 or 1; positions (N, 2) metres on the mask."""

    names: tuple[str, ...]
    codes: NDArray[np.bool_]
    positions: Array
    core_radius_m: float
    rim_radius_m: float

    def profile(self, radius_m: ArrayLike) -> Array:
        """Brightness 0..1 at a distance from a dot's centre: a raised cosine towards the rim."""
        width = self.rim_radius_m - self.core_radius_m
        ramp = np.clip((np.asarray(radius_m, float) - self.core_radius_m) / width, 0, 1)
        brightness: Array = 0.5 + 0.5 * np.cos(np.pi * ramp)
        return brightness


def load_dots(folder: Path) -> Dots:
    """Raises `ConfigError` CFG-* or DOTS-COLOUR."""
    path = folder / "dots.toml"
    return _from_settings(load(DotsSettings, path), str(path))


def _from_settings(settings: DotsSettings, source: str) -> Dots:
    for dot in settings.dot:
        if dot.colour not in COLOURS:
            raise ConfigError(
                "DOTS-COLOUR",
                f"{source}: the dot '{dot.name}' has the colour '{dot.colour}'",
                f"Use one of {', '.join(COLOURS)}.",
            )
    return Dots(
        tuple(dot.name for dot in settings.dot),
        np.array([COLOURS[dot.colour] for dot in settings.dot], bool),
        np.array([dot.position_m for dot in settings.dot], float),
        settings.core_radius_m,
        settings.rim_radius_m,
    )


def standard_dots() -> DotsSettings:
    """The layout above: half brightness at 3.5 mm from the centre, so 7 mm in diameter."""
    return DotsSettings(
        version=1,
        core_radius_m=0.002,
        rim_radius_m=0.005,
        dot=tuple(
            DotSettings(name=name, colour=colour, position_m=(x / 1000, y / 1000))
            for name, (colour, x, y) in LAYOUT_MM.items()
        ),
    )


def paint(dots: Dots, mask: Mask, width: int = TEXTURE_WIDTH) -> NDArray[np.uint8]:
    """The texture (height, width, 3) RGB over the relief's whole grid rectangle, row 0 at the top.

    u = (x + half width) / width and v = (half height - y) / height, as the stage maps it.
    """
    half_width, half_height = mask.half_size_m
    height = round(width * half_height / half_width)
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * half_width
    y = (1 - (np.arange(height) + 0.5) / height * 2) * half_height
    texture = np.zeros((height, width, 3))
    for code, (dot_x, dot_y) in zip(dots.codes, dots.positions, strict=True):
        radius = np.hypot(x[None, :] - dot_x, y[:, None] - dot_y)
        texture += dots.profile(radius)[..., None] * code
    return np.round(np.clip(texture, 0, 1) * 255).astype(np.uint8)


def _toml(settings: DotsSettings) -> str:
    lines = [
        "# The judge's test character. Metres; x to the audience's right, y up, on the mask.",
        "# Written by `python -m hypermask_sim.dots`, together with texture.png.",
        f"version = {settings.version}",
        f"core_radius_m = {settings.core_radius_m}",
        f"rim_radius_m = {settings.rim_radius_m}",
    ]
    for dot in settings.dot:
        x, y = dot.position_m
        lines += ["", "[[dot]]", f'name = "{dot.name}"', f'colour = "{dot.colour}"']
        lines += [f"position_m = [{x}, {y}]"]
    return "\n".join(lines) + "\n"


def write_dots(folder: Path, mask: Mask) -> Path:
    """Write dots.toml and texture.png; returns the folder."""
    settings = standard_dots()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "dots.toml").write_text(_toml(settings), "utf-8")
    texture = paint(_from_settings(settings, "dots"), mask)
    cv2.imwrite(str(folder / "texture.png"), cv2.cvtColor(texture, cv2.COLOR_RGB2BGR))
    return folder


if __name__ == "__main__":
    target = Path(sys.argv[1])
    mask_folder = Path(sys.argv[2] if len(sys.argv) > 2 else target / "../../masks/reference")
    print(write_dots(target, load_mask(mask_folder)))
