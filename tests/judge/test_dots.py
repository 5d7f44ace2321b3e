"""The test character: where its dots are and that no two can be taken for each other."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.mask import Mask, load_mask
from hypermask_sim.dots import SAME_COLOUR_M, Dots, load_dots, paint, write_dots

CONFIGS = Path(__file__).parents[2] / "configs"
FOLDER = CONFIGS / "characters/dots"


@pytest.fixture(scope="module")
def mask() -> Mask:
    return load_mask(CONFIGS / "masks/reference")


@pytest.fixture(scope="module")
def dots() -> Dots:
    return load_dots(FOLDER)


def test_dots_of_one_colour_are_far_apart(dots: Dots) -> None:
    for i, j in combinations(range(len(dots.names)), 2):
        apart = np.hypot(*(dots.positions[i] - dots.positions[j]))
        if (dots.codes[i] == dots.codes[j]).all():
            assert apart >= SAME_COLOUR_M
        assert apart > 4 * dots.rim_radius_m


def test_dots_lie_whole_on_the_lit_mask(dots: Dots, mask: Mask) -> None:
    angle = np.linspace(0, 2 * np.pi, 60)
    reach = dots.rim_radius_m + 0.002
    x = dots.positions[:, :1] + reach * np.cos(angle)
    y = dots.positions[:, 1:] + reach * np.sin(angle)
    assert mask.inside(x, y).all()
    for hole in mask.settings.eye_holes:
        away = np.hypot(*(dots.positions - hole.centre_m).T)
        assert (away > hole.radius_m + reach).all()


def test_dots_cover_the_face(dots: Dots, mask: Mask) -> None:
    x, y = dots.positions.T
    assert x.min() <= -0.07 and x.max() >= 0.07 and y.min() <= -0.1 and y.max() >= 0.1
    nose = dots.positions[dots.names.index("nose")]
    assert mask.height(*nose) > mask.relief.max() - 0.002
    everywhere = np.stack(np.meshgrid(np.linspace(-0.07, 0.07, 15), np.linspace(-0.1, 0.1, 21)), -1)
    nearest = np.linalg.norm(everywhere[:, :, None] - dots.positions, axis=-1).min(-1)
    assert nearest.max() < 0.05


def test_the_texture_shows_the_dots_of_the_file(dots: Dots, mask: Mask) -> None:
    stored = cv2.imread(str(FOLDER / "texture.png"))
    assert stored is not None
    image = cv2.cvtColor(stored, cv2.COLOR_BGR2RGB)
    assert image.shape == (1350, 1024, 3)
    np.testing.assert_array_equal(image, paint(dots, mask))
    half_width, half_height = mask.half_size_m
    for (x, y), code in zip(dots.positions, dots.codes, strict=True):
        column = (x + half_width) / (2 * half_width) * 1024 - 0.5
        row = (half_height - y) / (2 * half_height) * 1350 - 0.5
        assert (image[round(row), round(column)] == 255 * code).all()
        half = image[round(row), round(column + 0.0035 / (2 * half_width) * 1024)]
        # One texel is 0.2 mm, and the rim falls by 20 grey levels a texel.
        assert float(half.max()) == pytest.approx(128, abs=20)


def test_writing_again_gives_the_same_files(tmp_path: Path, mask: Mask) -> None:
    write_dots(tmp_path, mask)
    assert (tmp_path / "dots.toml").read_text() == (FOLDER / "dots.toml").read_text()
    written, committed = (cv2.imread(str(f / "texture.png")) for f in (tmp_path, FOLDER))
    np.testing.assert_array_equal(written, committed)


def test_an_unknown_colour_is_named(tmp_path: Path) -> None:
    text = (FOLDER / "dots.toml").read_text().replace('"cyan"', '"turquoise"', 1)
    (tmp_path / "dots.toml").write_text(text)
    with pytest.raises(ConfigError, match=r"DOTS-COLOUR: .*temple_right.*turquoise"):
        load_dots(tmp_path)
