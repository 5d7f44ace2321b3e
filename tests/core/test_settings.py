"""A wrong configuration is explained by file, key and the nearest known key."""

from pathlib import Path

import pytest

from hypermask.config import Settings, load, override, parse
from hypermask.errors import ConfigError


class Lens(Settings):
    focal_px: float = 900.0


class Cart(Settings):
    camera: Lens = Lens()
    lenses: tuple[Lens, ...] = ()
    name: str


def explain(tmp_path: Path, text: str) -> ConfigError:
    path = tmp_path / "cart.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load(Cart, path)
    assert str(path) in str(caught.value)
    return caught.value


def test_an_unknown_key_names_the_nearest(tmp_path: Path) -> None:
    error = explain(tmp_path, 'name = "x"\n[camera]\nfocal_pix = 3\n')
    assert error.code == "CFG-KEY"
    assert "camera.focal_pix" in str(error) and "'focal_px'" in str(error)


def test_an_unknown_key_in_a_list_of_tables(tmp_path: Path) -> None:
    error = explain(tmp_path, 'name = "x"\n[[lenses]]\nfocal = 3\n')
    assert error.code == "CFG-KEY" and "'focal_px'" in str(error)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "CFG-MISSING"),
        ("name = 3", "CFG-VALUE"),
        ('name = "x"\n[camera]\nfocal_px = nan', "CFG-VALUE"),
        ("name = ", "CFG-SYNTAX"),
    ],
)
def test_every_other_fault_has_its_code(tmp_path: Path, text: str, code: str) -> None:
    assert explain(tmp_path, text).code == code


def test_an_absent_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="CFG-ABSENT"):
        load(Cart, tmp_path / "nothing.toml")


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "cart.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="CFG-READ"):
        load(Cart, path)


def test_set_overrides_nested_keys_and_reads_plain_text() -> None:
    data = override({"name": "x"}, ["camera.focal_px=500", "name=a b.csv"])
    cart = parse(Cart, data, "--set")
    assert cart.camera.focal_px == 500 and cart.name == "a b.csv"


@pytest.mark.parametrize("text", ["name", "=3", "name.inner=3"])
def test_set_that_cannot_be_meant(text: str) -> None:
    with pytest.raises(ConfigError):
        override({"name": "x"}, [text])
