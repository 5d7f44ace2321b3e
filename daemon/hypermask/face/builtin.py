"""Makes the built-in characters of `configs/characters`.

    python -m hypermask.face.builtin FOLDER_OF_FACES

`mean` is the mean of many faces in the normalised layout (attribution in NOTICE); the others are
theatre make-up painted on to it (`hypermask.face.makeup`). Nobody is recognisable in any of them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.face.character import Character, save_character
from hypermask.face.makeup import MAKEUPS
from hypermask.texture import regions
from hypermask.texture.eyes import eye_textures
from hypermask.texture.fill import belief, diffuse
from hypermask.texture.landmarks import FaceFinder
from hypermask.texture.normalise import normalise
from hypermask.texture.photo import load_photo

Image = NDArray[np.uint8]

DATE = "2026-11-22"
SOURCE = (
    "mean of 130 faces: Face Research Lab London Set and its Canadian companion, "
    "DeBruine and Jones, CC BY 4.0"
)
_EXPOSURE = 1.12
_RIM_SHADE = 0.30
_SHARPEN = (0.9, 2.2)
"""How much and how wide (texels): averaging 130 faces takes away what this gives back."""


def mean_face(photos: list[Path]) -> Image:
    """(SIZE, SIZE, 3) BGR mean of the normalised photographs, skin carried out to the rim."""
    finder = FaceFinder()
    total = np.zeros(1, np.float64)
    weight = np.zeros(1, np.float64)
    for photo in photos:
        image = load_photo(photo)
        face = finder.find(image)
        texture = normalise(image, face.points[:, :2], face.eye_distance)
        believed = belief(texture).astype(float)
        total = total + texture * believed[..., None]
        weight = weight + believed
    mean = (total / np.maximum(weight, 1e-6)[..., None]).astype(np.float32)
    mean = _sharpen(_symmetric(mean))
    share = regions.ramp((weight / len(photos)).astype(np.float32), 0.2, 0.8)
    share = _symmetric(regions.soften(share, 3)) * regions.ramp(regions.depth_mm(), 2, 12)
    skin = share * (1 - regions.features())
    spread = diffuse(cv2.GaussianBlur(mean, (0, 0), 3).astype(np.float32), skin)
    smooth = cv2.GaussianBlur(spread, (0, 0), 8)
    whole = mean * share[..., None] + smooth * (1 - share[..., None])
    return np.clip(whole * _rim_shade(), 0, 255).astype(np.uint8)


def _sharpen(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Inside the face only, so that nothing rings along its outline."""
    amount, sigma = _SHARPEN
    blurred = cv2.GaussianBlur(image, (0, 0), sigma)
    fine, broad = image - blurred, blurred - cv2.GaussianBlur(image, (0, 0), 5 * sigma)
    inside = regions.ramp(regions.depth_mm(), 6, 24)[..., None]
    return np.asarray((image + inside * amount * (fine + 0.35 * broad)) * _EXPOSURE, np.float32)


def _symmetric(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """The studio's light comes from both sides; what is left of one side is taken away."""
    return np.asarray((image + image[:, ::-1]) / 2, np.float32)


def _rim_shade() -> NDArray[np.float32]:
    """Darker towards the rim, as a round head is: the mask itself is flatter."""
    outside = regions.ramp(-regions.depth_mm(), -22, 40)
    return np.asarray(1 - _RIM_SHADE * outside, np.float32)[..., None]


def main() -> None:
    shelf = paths.configs() / "characters"
    mean = mean_face(sorted(Path(sys.argv[1]).glob("*.jpg")))
    eyes = eye_textures(mean)
    faces = {"mean": (mean, eyes, SOURCE)}
    for name, paint in MAKEUPS.items():
        texture, balls = paint(mean, eyes)
        faces[name] = (texture, balls, f"painted on the {SOURCE}")
    for name, (texture, balls, source) in faces.items():
        rgb, rgb_eyes = (np.ascontiguousarray(i[..., ::-1]) for i in (texture, balls))
        save_character(Character(name, source, DATE, rgb, rgb_eyes), shelf / name, 9)
        size = (shelf / name / "texture.png").stat().st_size
        print(f"{name}: texture.png {size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
