"""A show on a Mask-bot: the light on its screen, and the head by the show's orders."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hypermask import paths
from hypermask.bench.runs import scenario
from hypermask.machine.places import mask_folder
from hypermask.machine.settings import MachineSettings
from hypermask.mask import load_mask
from hypermask.rehearsal.cart import SimulatedCart, true_screen
from hypermask.rehearsal.head import swings
from hypermask.rehearsal.lockstep import LockStep
from hypermask.rehearsal.run import play
from hypermask.rehearsal.show_parts import casting_of
from hypermask.services.rig import nominal_screen
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.settings import load
from hypermask_sim.audience_robot import audience_of
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World


def maskbot(*more: str) -> Scenario:
    return scenario("maskbot", "character=dots", "projector.rate_hz=10", *more)


def report(of: Scenario, exact: bool = True) -> dict[str, Any]:
    return play(of, None, False, True, true_screen(World(of)) if exact else None)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_after_the_operators_nudges_the_picture_is_within_half_a_millimetre(seed: int) -> None:
    found = report(maskbot("duration_s=0.4", "performer.keys=[]", f"seed={seed}"), exact=False)
    assert found["registration_mm"]["rms"] <= 0.5
    assert found["registration_mm"]["max"] <= 1.2
    assert found["calibration"]["kind"] == "fixed"


def test_the_builders_figures_alone_would_be_millimetres_off() -> None:
    of = maskbot("duration_s=0.4", "performer.keys=[]")
    from hypermask.rehearsal.cart import nominal_screen as by_scenario

    found = play(of, None, False, True, by_scenario(World(of)))
    assert found["registration_mm"]["rms"] > 2.0


@pytest.fixture(scope="module")
def gestures() -> dict[str, Any]:
    """Looks to its left, nods, shakes."""
    keys = '[[0.9, "7"], [3.0, "5"], [6.6, "6"]]'
    found: dict[str, Any] = report(maskbot("duration_s=11.0", f"performer.keys={keys}"))
    return found


def order(found: dict[str, Any], number: int) -> dict[str, Any]:
    wanted: dict[str, Any] = found["head"]["orders"][number]
    return wanted


def test_the_picture_stays_on_the_screen_however_the_head_turns(gestures: dict[str, Any]) -> None:
    assert gestures["registration_mm"]["rms"] <= 0.1


def test_a_cue_turns_the_head(gestures: dict[str, Any]) -> None:
    look = order(gestures, 1)
    assert look["gesture"] == "look"
    assert look["look_deg"] == [28.0, 0.0]
    assert look["off_deg"] <= 0.2
    # Each order is heard at the worker's next turn after the cue.
    assert 0.9 <= look["time_s"] <= 1.0
    path = gestures["head"]["path"]
    looking = [
        pan for time_s, pan in zip(path["time_s"], path["pan_deg"], strict=True) if time_s < 3
    ]
    assert max(looking) == pytest.approx(28.0, abs=0.5)


def test_it_nods_and_shakes(gestures: dict[str, Any]) -> None:
    nod, shake = order(gestures, 2), order(gestures, 3)
    assert (nod["gesture"], shake["gesture"]) == ("nod", "shake")
    assert nod["swings"][0] == 0
    assert nod["swings"][1] >= 3  # down, up, down, up
    assert shake["swings"][0] >= 3
    assert shake["swings"][1] == 0
    assert nod["off_deg"] <= 0.5


def test_the_head_keeps_to_its_orders_in_time(gestures: dict[str, Any]) -> None:
    assert abs(gestures["head"]["behind_ms"]) <= 50
    assert gestures["head"]["behind_deg"]["p50"] <= 1.0
    assert gestures["head"]["behind_deg"]["max"] <= 4.0
    path = gestures["head"]["path"]
    assert np.diff(path["time_s"]) == pytest.approx(0.05, abs=1e-6)


def test_a_head_whose_unit_vanishes_stays_where_it_is_and_the_face_goes_on() -> None:
    fault = 'faults=[{kind="pantilt_lost", from_s=0.5, to_s=1.0}]'
    keys = 'performer.keys=[[0.3, "7"]]'
    found = report(maskbot("duration_s=2.8", keys, fault))
    codes = [event["code"] for event in found["events"]]
    assert codes.count("PTU-LOST") == 1
    assert codes.count("PANTILT-BACK") == 1
    assert found["registration_mm"]["rms"] <= 0.1
    assert found["registration_mm"]["black_frames"] <= 1
    assert found["head"]["pan_deg"][1] > 20  # it goes on when the unit is back


def test_the_same_again_gives_the_same_report() -> None:
    of = maskbot("duration_s=0.8", 'performer.keys=[[0.2, "5"]]')
    assert report(of) == report(of)


def test_a_cart_without_a_neck_reports_no_head() -> None:
    found = play(
        scenario("reference-cart", "duration_s=0.1", "calibration.method=exact"), None, False, True
    )
    assert found["head"] is None


def test_the_same_show_voice_and_characters_play_on_it() -> None:
    of = scenario(
        "maskbot", "projector.rate_hz=10", "duration_s=1.6", 'performer.keys=[[0.2, "5"]]'
    )
    cart = scenario("demo")
    assert casting_of(of).show == casting_of(cart).show
    found = report(of)
    assert max(max(row) for row in found["mouth"]["parameters"]) > 0.1  # it speaks
    assert found["registration_mm"]["rms"] <= 0.1


def test_the_audience_sees_the_head_turn() -> None:
    world = World(maskbot("performer.keys=[]"))
    cart = SimulatedCart(world, VirtualClock())
    lockstep = LockStep(cart, true_screen(world), casting_of(world.scenario))
    flips = lockstep.play(1.0)
    flip = [next(flips) for _ in range(3)][-1]
    assert flip is not None
    audience = audience_of(cart.projector.context, world, (480, 360))

    def nose(pan_deg: float, tilt_deg: float) -> tuple[float, float]:
        """Where the light of the screen is seen: x to the right, y down."""
        world.neck = lambda time_s: (np.radians(pan_deg), np.radians(tilt_deg))
        view = audience.render(flip.shown, 0.0).astype(float)
        white = np.clip(view.min(axis=2) - 140, 0, None)
        rows, columns = np.indices(white.shape)
        return (white * columns).sum() / white.sum(), (white * rows).sum() / white.sum()

    straight, left, up = nose(0, 0), nose(25, 0), nose(0, 15)
    assert left[0] > straight[0] + 5
    assert up[1] < straight[1] - 3
    world.neck = lambda time_s: (0.0, 0.0)
    dark = audience.render(np.zeros_like(flip.shown), 0.0)
    assert dark.max() < 140
    audience.close()
    lockstep.close()


def test_swings_are_counted_without_the_small_ones() -> None:
    way = np.radians([0, -5, -11, -6, 2, 4, 4.5, 4, -3, -8, 0, 0.2, 0])
    assert swings(way) == 3
    assert swings(np.zeros(5)) == 0
    assert swings(np.radians(np.arange(10.0))) == 0


def test_the_machine_file_is_good_and_says_what_the_scenario_believes() -> None:
    machine = load(MachineSettings, paths.configs() / "machines" / "maskbot.toml")
    assert machine.mapping == "fixed"
    assert machine.device("camera") is None
    assert machine.device("pantilt") is not None
    from hypermask.rehearsal.cart import nominal_screen as by_scenario

    points = load_mask(mask_folder(machine.mask)).leds
    theirs = by_scenario(World(maskbot())).project(points)
    assert nominal_screen(machine).project(points) == pytest.approx(theirs, abs=1e-6)
    assert load_mask(mask_folder(machine.mask)).settings.eye_holes == ()
