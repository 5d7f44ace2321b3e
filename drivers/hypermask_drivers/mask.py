"""The mask as a piece of hardware: where its LEDs sit, its relief, its outline and its eye holes.

Read from a folder with `mask.toml` and a 16-bit grey PNG, the relief's height map. Mask frame:
metres; origin in the centre of the four corner LEDs; x to the audience's right, y up, z towards
the audience.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.settings import Settings, load

Array = NDArray[np.float64]

_REMAP_ROW = 256

LED_NAMES = ("upper_left", "upper_right", "lower_right", "lower_left", "label")
"""Left and right as the audience sees the mask; `label` is the fifth, on the nose."""


class LedSettings(Settings):
    position_m: tuple[float, float, float]
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)


class ReliefSettings(Settings):
    file: str
    spacing_m: float = Field(gt=0)
    metres_per_step: float = Field(gt=0)
    offset_m: float


class OutlineSettings(Settings):
    """A superellipse |x/half_width|^n + |(y-centre)/half_height|^n = 1."""

    half_width_m: float = Field(gt=0)
    half_height_m: float = Field(gt=0)
    exponent: float = Field(ge=2)


class EyeHoleSettings(Settings):
    centre_m: tuple[float, float]
    radius_m: float = Field(ge=0)


class MaskSettings(Settings):
    version: int = Field(ge=1, le=1)
    name: str
    leds: dict[str, LedSettings]
    relief: ReliefSettings
    outline: OutlineSettings
    eye_holes: tuple[EyeHoleSettings, ...] = ()


@dataclass(frozen=True)
class Mask:
    """settings: the file; leds, normals: (5, 3) in `LED_NAMES` order; relief: (rows, columns) m.

    The relief's grid is centred on the origin; row 0 is the TOP (largest y).
    """

    settings: MaskSettings
    leds: Array
    normals: Array
    relief: NDArray[np.float32]

    @property
    def half_size_m(self) -> tuple[float, float]:
        """Half width and height of the relief's grid, in metres."""
        rows, columns = self.relief.shape
        spacing = self.settings.relief.spacing_m
        return (columns - 1) / 2 * spacing, (rows - 1) / 2 * spacing

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """z of the surface in metres at (x, y) metres, bilinear; the border goes on outwards."""
        import cv2  # not above: half of a process's start, and most processes never need it

        xs, ys = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(y, np.float32))
        half_width, half_height = self.half_size_m
        spacing = self.settings.relief.spacing_m
        # remap takes no map with a side of 32767 or more.
        points = np.zeros((2, xs.size // _REMAP_ROW + 1, _REMAP_ROW), np.float32)
        points.reshape(2, -1)[:, : xs.size] = xs.ravel(), ys.ravel()
        columns = (points[0] + np.float32(half_width)) / np.float32(spacing)
        rows = (np.float32(half_height) - points[1]) / np.float32(spacing)
        z = cv2.remap(self.relief, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(z, float).ravel()[: xs.size].reshape(xs.shape)

    def inside(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Whether (x, y) metres lies inside the mask's outline."""
        outline = self.settings.outline
        n = outline.exponent
        radius = (
            np.abs(np.asarray(x, float) / outline.half_width_m) ** n
            + np.abs(np.asarray(y, float) / outline.half_height_m) ** n
        )
        return np.asarray(radius <= 1)


def load_mask(folder: Path) -> Mask:
    """Raises `ConfigError` (CFG-*, MASK-LEDS, MASK-RELIEF)."""
    settings = load_mask_settings(folder)
    leds = np.array([settings.leds[name].position_m for name in LED_NAMES])
    normals = np.array([settings.leds[name].normal for name in LED_NAMES])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mask(settings, leds, normals, _load_relief(folder / settings.relief.file, settings))


def load_mask_settings(folder: Path) -> MaskSettings:
    """A mask without its relief, at once. Raises `ConfigError` (CFG-*, MASK-LEDS)."""
    settings = load(MaskSettings, folder / "mask.toml")
    if set(settings.leds) != set(LED_NAMES):
        raise ConfigError(
            "MASK-LEDS",
            f"{folder / 'mask.toml'} names the LEDs {sorted(settings.leds)}",
            f"Name exactly {', '.join(LED_NAMES)}.",
        )
    return settings


def _load_relief(path: Path, settings: MaskSettings) -> NDArray[np.float32]:
    import cv2

    steps = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
    if steps is None or steps.dtype != np.uint16 or steps.ndim != 2 or min(steps.shape) < 2:
        raise ConfigError(
            "MASK-RELIEF", f"{path} is not a 16-bit grey PNG", "Restore the mask's folder."
        )
    relief = settings.relief
    return (steps * relief.metres_per_step + relief.offset_m).astype(np.float32)
