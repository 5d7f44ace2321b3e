"""The emulated unit says byte for byte what the PTU-D46 manual (2.14, section 4) says."""

import itertools

import pytest

from hypermask_sim.emulators.ptu import PtuData, PtuUnit


def unit(**data: object) -> PtuUnit:
    return PtuUnit(PtuData(baud=None, **data))  # type: ignore[arg-type]


def say(unit: PtuUnit, text: str, time_s: float = 1.0) -> str:
    unit.receive(text.encode(), time_s)
    return unit.transmit(time_s).decode()


def quiet(unit: PtuUnit) -> PtuUnit:
    say(unit, "ED FT ", 0.0)
    return unit


def test_the_start_sequence_of_the_drivers_in_the_field() -> None:
    ptu = unit()
    assert say(ptu, "ft ") == "ft *\r\n"
    assert say(ptu, "ed ") == "ed *\r\n"
    assert say(ptu, "ci ") == "*\r\n"
    asked = ["tr", "pr", "pn", "px", "tn", "tx", "pl", "pu", "tl", "tu"]
    answers = [say(ptu, f"{query} ") for query in asked]
    assert answers == [
        "* 185.1428\r\n", "* 185.1428\r\n", "* -3090\r\n", "* 3090\r\n", "* -907\r\n",
        "* 604\r\n", "* 31\r\n", "* 2902\r\n", "* 31\r\n", "* 2902\r\n",
    ]  # fmt: skip
    assert say(ptu, "pp100 ") == say(ptu, "tp-50 ") == say(ptu, "ps600 ") == "*\r\n"


def test_a_reset_homes_and_ends_as_the_drivers_in_the_field_expect() -> None:
    ptu = quiet(unit(homing_s=3.0))
    assert say(ptu, " r ", 2.0) == ""
    assert ptu.transmit(4.99) == b""
    assert ptu.transmit(5.0) == b"!T!T!P!P*\r\n"
    assert say(ptu, "pp tp ", 5.0) == "* 0\r\n* 0\r\n"


def test_commands_sent_during_a_reset_are_obeyed_after_it() -> None:
    ptu = quiet(unit(homing_s=3.0))
    assert say(ptu, "r pp ", 2.0) == ""
    assert ptu.transmit(5.0) == b"!T!T!P!P*\r\n* 0\r\n"


@pytest.mark.parametrize(
    ("query", "answer"),
    [
        ("PP", "* Current Pan position is 0"),
        ("TO", "* Target Tilt position is 0"),
        ("PR", "* 185.1428 seconds arc per Pan position"),
        ("TN", "* Minimum Tilt position is -907"),
        ("PX", "* Maximum Pan position is 3090"),
        ("PS", "* Target Pan speed is 1000 positions/sec"),
        ("TA", "* Tilt acceleration is 2000 positions/sec^2"),
        ("PB", "* Current Pan base speed is 1000 positions/sec"),
        ("PU", "* Maximum Pan speed is 2902 positions/sec"),
        ("TL", "* Minimum Tilt speed is 31 positions/sec"),
        ("F", "* ASCII verbose mode"),
        ("L", "* Limit bounds are ENABLED (soft limits enabled)"),
        ("O", "* Input 24 VDC @ 86 degF"),
    ],
)
def test_verbose_answers(query: str, answer: str) -> None:
    ptu = unit()
    say(ptu, "ED ")
    ptu.axes["T"].place(0, 0.0)
    assert say(ptu, f"{query} ") == f"{answer}\r\n"


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("PP3200", "! Maximum allowable Pan position is 3090"),
        ("TP-1000", "! Minimum allowable Tilt position is -907"),
        ("PS3300", "! Pan speed cannot exceed 2902 positions/sec"),
        ("PL20", "! Motor speed cannot be less than 31 pos/sec"),
        ("XYZ", "! Illegal command: XYZ"),
    ],
)
def test_refusals(command: str, answer: str) -> None:
    assert say(quiet(unit()), f"{command} ") == f"{answer}\r\n"


def test_echo_repeats_what_it_is_sent() -> None:
    ptu = unit()
    say(ptu, "FT ")
    assert say(ptu, "PP ") == "PP * 0\r\n"
    assert say(ptu, "ED ") == "ED *\r\n"
    assert say(ptu, "PP ") == "* 0\r\n"


def test_disabled_limits_let_positions_beyond_them_pass() -> None:
    ptu = quiet(unit())
    assert say(ptu, "LD PP3200 ") == "*\r\n*\r\n"


def test_await_answers_when_the_head_has_arrived() -> None:
    ptu = quiet(unit())
    say(ptu, "ps1000 pp500 ", 1.0)
    assert say(ptu, "a ", 1.0) == ""
    assert ptu.transmit(1.49) == b""
    assert ptu.transmit(1.5) == b"*\r\n"


def test_slaved_positions_wait_for_the_await() -> None:
    ptu = quiet(unit())
    say(ptu, "s pp500 ", 1.0)
    assert say(ptu, "pp po ", 3.0) == "* 0\r\n* 500\r\n"
    say(ptu, "a ", 3.0)
    assert say(ptu, "pp ", 4.0) == "*\r\n* 500\r\n"


def test_speed_is_trapezoidal_above_the_base_speed() -> None:
    """2000 steps/s^2 to 2000 steps/s: one second and 1000 steps each to speed up and slow down."""
    ptu = quiet(unit())
    say(ptu, "ps2000 pp-3000 ", 0.0)
    ptu.transmit(10.0)
    say(ptu, "pp3000 ", 10.0)
    places = [ptu.axes["P"].exact(10 + t) for t in (0.0, 0.5, 1.0, 2.0, 3.0, 3.5, 4.0)]
    assert places == pytest.approx([-3000, -2750, -2000, 0, 2000, 2750, 3000])


def test_halt_stops_at_once_at_base_speed_and_brakes_above_it() -> None:
    ptu = quiet(unit())
    say(ptu, "ps1000 pp2000 ", 0.0)
    say(ptu, "h ", 1.0)
    assert (ptu.axes["P"].exact(1.0), ptu.axes["P"].exact(9.0)) == (1000, 1000)
    say(ptu, "ps2000 pp-3000 ", 10.0)
    say(ptu, "h ", 11.5)
    assert ptu.axes["P"].speed(12.4) < 300 and ptu.axes["P"].speed(12.5) == 0


def test_a_byte_takes_ten_bits_of_time() -> None:
    ptu = PtuUnit(PtuData(baud=9600))
    ptu.receive(b"ED ", 1.0)  # echoed as it comes, then answered: "ED *\r\n"
    sent = [len(ptu.transmit(1.0 + count * 10 / 9600 + 1e-9)) for count in range(9)]
    assert sent == [0, 0, 1, 1, 1, 1, 1, 1, 0]


def test_a_power_cycle_forgets_everything_and_prints_a_banner() -> None:
    ptu = quiet(unit(homing_s=3.0))
    say(ptu, "pp500 ", 1.0)
    ptu.power_cycle(5.0)
    banner = ptu.transmit(5.0).decode()
    assert banner.startswith("### Pan-Tilt Controller") and banner.endswith("\r\n")
    assert ptu.transmit(8.0) == b"*\r\n"
    assert say(ptu, "PP ", 8.0) == "PP * Current Pan position is 0\r\n"


def test_a_silent_unit_hears_nothing_and_says_nothing() -> None:
    ptu = quiet(unit())
    ptu.fall_silent(until_s=5.0)
    assert say(ptu, "pp500 ", 2.0) == ""
    assert say(ptu, "po ", 5.0) == "* 0\r\n"


def test_it_never_exceeds_its_speed_whatever_it_is_told_on_the_way() -> None:
    ptu = quiet(unit())
    places = []
    for step in range(600):
        now = step * 0.01
        if step % 37 == 0:
            say(ptu, f"ps{500 + 350 * (step % 5)} pp{(step * 97) % 6000 - 3000} ", now)
        places.append(ptu.axes["P"].exact(now))
    speeds = [abs(b - a) / 0.01 for a, b in itertools.pairwise(places)]
    assert max(speeds) <= 1900 + 1e-6
