"""Scenario files: what they inherit, what they refuse, where their paths are looked for."""

from pathlib import Path

import pytest

from hypermask_drivers.errors import ConfigError
from hypermask_sim.scenario import Scenario, load_scenario
from hypermask_sim.world import World

SCENARIOS = Path(__file__).parents[2] / "configs" / "scenarios"


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, "utf-8")
    return path


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_scenario_makes_a_world(path: Path) -> None:
    world = World(load_scenario(path))
    assert world.scenario.name == path.stem
    assert world.duration_s > 0


def test_the_reference_cart_is_the_yardstick() -> None:
    world = World(load_scenario(SCENARIOS / "reference-cart.toml"))
    camera, projector = world.scenario.camera, world.scenario.projector
    assert (camera.width, camera.height, camera.rate_hz) == (1280, 800, 120)
    assert world.camera.K[0, 0] == world.camera.K[1, 1] == 900
    assert (camera.exposure_ms, camera.available_ms, camera.read_noise) == (1.0, 9.3, 2.0)
    assert (projector.width, projector.height, projector.rate_hz) == (1280, 720, 60)
    assert world.projector.K[0, 0] == world.projector.K[1, 1] == 1920
    assert world.projector.K[:2, 2].tolist() == [639.5, 719.5]
    assert world.projector.R.tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert world.projector.t.tolist() == [-0.15, 0, 0]
    assert world.light_time(1.0) == pytest.approx(1.0 + 0.017 + 0.5 / 60)
    assert len(world.scenario.reflections) == 6
    assert sum(spot.to_m is not None for spot in world.scenario.reflections) == 1
    assert (world.scenario.latency.tracking_ms, world.scenario.latency.latch_ms) == (1, 3)


def test_the_fast_cart_differs_in_nothing_but_speed() -> None:
    fast = load_scenario(SCENARIOS / "fast-cart.toml")
    reference = load_scenario(SCENARIOS / "reference-cart.toml")
    assert (fast.camera.rate_hz, fast.camera.available_ms) == (240, 4.2)
    assert (fast.projector.rate_hz, fast.projector.light_ms) == (120, 8)
    assert fast.reflections == reference.reflections
    assert fast.projector.centre_px == reference.projector.centre_px


def test_extends_changes_key_by_key_and_replaces_lists(tmp_path: Path) -> None:
    written(
        tmp_path, "a.toml", "[camera]\nwidth = 640\nheight = 480\n[calibration]\ndistances_m=[1]"
    )
    written(tmp_path, "b.toml", 'extends = "a.toml"\n[camera]\nwidth = 320')
    path = written(tmp_path, "c.toml", 'extends = "b.toml"\n[calibration]\ndistances_m = [2, 3]')
    scenario = load_scenario(path)
    assert (scenario.camera.width, scenario.camera.height) == (320, 480)
    assert scenario.calibration.distances_m == (2, 3)


def test_assignments_come_last(tmp_path: Path) -> None:
    path = written(tmp_path, "a.toml", "[performer]\ndistance_m = 2.0")
    scenario = load_scenario(path, ["performer.distance_m=1.5", "performer.motion=walk"])
    assert scenario.performer.distance_m == 1.5
    assert scenario.performer.motion == ("walk",)


def test_paths_are_found_beside_the_file_that_states_them(tmp_path: Path) -> None:
    (tmp_path / "clips").mkdir()
    (tmp_path / "shows").mkdir()
    clip = written(tmp_path / "clips", "clip.csv", "")
    written(tmp_path / "clips", "base.toml", '[performer]\nmotion = ["gone.csv", "clip.csv"]')
    path = written(tmp_path / "shows", "show.toml", 'extends = "../clips/base.toml"')
    assert load_scenario(path).performer.motion == ("gone.csv", str(clip.resolve()))


def test_assigned_paths_are_found_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "a.toml", "")
    clip = written(tmp_path, "clip.csv", "")
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario(path, ["performer.motion=clip.csv"])
    assert scenario.performer.motion == (str(clip.resolve()),)


@pytest.mark.parametrize(
    ("text", "code", "says"),
    [
        ("[camera]\nwidht = 3", "CFG-KEY", "Did you mean 'width'"),
        ("[[faults]]\nkind = 'flash'\nlevle = 3", "CFG-KEY", "Did you mean 'level'"),
        ("camera = 3", "CFG-VALUE", "camera"),
        ("[camera]\nrate_hz = 0", "CFG-VALUE", "camera.rate_hz"),
        ("[camera]\nrate_hz = nan", "CFG-VALUE", "camera.rate_hz"),
        ("[camera]\nrate_hz = 1e300", "CFG-VALUE", "camera.rate_hz"),
        ("[performer]\nkeys = [[1.0, 'F1']]", "CFG-VALUE", "there is no key 'F1'"),
        ("[performer]\nmotion = []", "CFG-VALUE", "performer.motion"),
        ("[[faults]]\nkind = 'flash'\nleds = ['label']", "CFG-VALUE", "'leds' means nothing"),
        ("[[faults]]\nkind = 'leds_hidden'\nleds = ['nose']", "CFG-VALUE", "no LED 'nose'"),
        ("[[faults]]\nkind = 'flash'\nfrom_s = 3\nto_s = 2", "CFG-VALUE", "later than from_s"),
        ("[[faults]]\nfrom_s = 3", "CFG-MISSING", "kind"),
        ("[[reflections]]\nposition_m = [0, 0, -1]", "CFG-VALUE", "in front of the camera"),
        ("mapping = 'magic'", "CFG-VALUE", "mapping"),
        ("x = ", "CFG-SYNTAX", "not valid TOML"),
        ("extends = 'gone.toml'", "CFG-ABSENT", "gone.toml"),
        ("extends = 3", "CFG-VALUE", "extends"),
        ("extends = 'wrong.toml'", "CFG-EXTENDS", "extends itself"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, text: str, code: str, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario(written(tmp_path, "wrong.toml", text))
    assert caught.value.code == code
    assert says in str(caught.value) and "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_wrong_base_file_is_named_itself(tmp_path: Path) -> None:
    written(tmp_path, "base.toml", "[camera]\nwidht = 3")
    with pytest.raises(ConfigError, match=r"base\.toml: unknown key 'camera\.widht'"):
        load_scenario(written(tmp_path, "top.toml", 'extends = "base.toml"'))


def test_a_still_copy_keeps_the_cart() -> None:
    scenario = Scenario().with_changes(["performer.motion=walk", "camera.rate_hz=90"])
    still = scenario.still(2.4)
    assert still.performer.motion == ("still",)
    assert still.performer.distance_m == 2.4
    assert still.camera == scenario.camera
