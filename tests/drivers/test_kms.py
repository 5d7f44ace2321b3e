"""What of the KMS projector needs no display: properties, events, tables, choices."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.drm_card import (
    Card,
    Connector,
    Property,
    commit_error,
    parse_enumeration,
    parse_flip,
)
from hypermask_drivers.projector.drm_modes import modeline
from hypermask_drivers.projector.kms import KmsProjector
from hypermask_drivers.projector.kms_choice import Choice
from hypermask_drivers.projector.kms_console import force_connector, silence_console
from hypermask_drivers.projector.kms_output import Output, card_paths, curve, find_connector
from hypermask_drivers.projector.kms_settings import KmsSettings

HD = "74.25 1280 1390 1430 1650 720 725 730 750 +hsync +vsync"


# What the kernel says


def test_enumerations_are_read() -> None:
    data = struct.pack("=Q32sQ32s", 0, b"Overlay", 1, b"Primary")
    assert parse_enumeration(data) == {"Overlay": 0, "Primary": 1}


def event(kind: int, seconds: int, micro: int, sequence: int) -> bytes:
    return bytes(abi.VblankEvent(kind, 32, 0, seconds, micro, sequence, 40))


def test_the_flips_end_is_found_among_the_events() -> None:
    data = event(1, 5, 0, 6) + event(2, 7, 250_000, 8)
    flip = parse_flip(data)
    assert flip is not None and (flip.time_s, flip.sequence) == (7.25, 8)
    assert parse_flip(event(1, 5, 0, 6)) is None and parse_flip(b"") is None
    assert parse_flip(data[:40]) is None


@pytest.mark.parametrize(
    ("number", "code"), [(13, "PRJ-MASTER"), (19, "PRJ-LOST"), (22, "PRJ-COMMIT")]
)
def test_why_a_picture_is_refused(number: int, code: str) -> None:
    error = commit_error(OSError(number, "said so"))
    assert error.code == code and isinstance(error, DeviceLost)


# Tables and files


def test_the_brightness_table() -> None:
    table = np.frombuffer(bytes(curve(256, 0.5, 2.0)), np.uint16).reshape(256, 4)  # type: ignore[call-overload]
    assert table[0].tolist() == [0, 0, 0, 0]
    assert table[255].tolist() == [32768, 32768, 32768, 0]
    assert table[128, 0] == pytest.approx(65535 * 0.5 * (128 / 255) ** 2, abs=1)


def test_cards_are_opened_by_their_stable_names(tmp_path: Path) -> None:
    (tmp_path / "card1").touch()
    (tmp_path / "renderD128").touch()
    assert card_paths(None, tmp_path) == [str(tmp_path / "card1")]
    (tmp_path / "by-path").mkdir()
    (tmp_path / "by-path/platform-gpu-card").touch()
    (tmp_path / "by-path/platform-gpu-render").touch()
    assert card_paths(None, tmp_path) == [str(tmp_path / "by-path/platform-gpu-card")]
    assert card_paths("/dev/dri/card7", tmp_path) == ["/dev/dri/card7"]


def test_forcing_a_connector_writes_its_status(tmp_path: Path) -> None:
    assert not force_connector("/dev/dri/card0", "HDMI-A-1", tmp_path)
    (tmp_path / "card0-HDMI-A-1").mkdir()
    assert force_connector("/dev/dri/card0", "HDMI-A-1", tmp_path)
    assert (tmp_path / "card0-HDMI-A-1/status").read_text() == "on"


def test_a_console_that_is_not_there_is_silent(tmp_path: Path) -> None:
    assert silence_console(tmp_path / "tty0", tmp_path / "fb0")
    (tmp_path / "tty0").touch()  # no terminal: its mode cannot be set
    assert not silence_console(tmp_path / "tty0", tmp_path / "fb0")


def test_only_a_device_is_painted_black(tmp_path: Path) -> None:
    (tmp_path / "fb0").write_text("a file")
    assert not silence_console(tmp_path / "tty0", tmp_path / "fb0")
    assert (tmp_path / "fb0").read_text() == "a file"


# Choices, over a card made of Python

CRTC, CONNECTOR, MIRROR, PLANE, CURSOR = 40, 50, 51, 60, 61


class PaperCard:
    """Two connectors on one CRTC, a primary and a cursor plane; keeps what is committed."""

    def __init__(self, path: str = "/dev/dri/card0") -> None:
        self.path, self.closed = path, False
        self.left: dict[str, int] = {}
        self.commits: list[tuple[dict[int, dict[int, int]], int]] = []
        self.connected: dict[int, bool | None] = {CONNECTOR: False, MIRROR: True}
        self.blobs = 0
        self.lut = True

    def close(self) -> None:
        self.closed = True

    def resources(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        return (CRTC,), (CONNECTOR, MIRROR)

    def connector(self, number: int) -> Connector:
        name = {CONNECTOR: "HDMI-A-1", MIRROR: "DP-1"}[number]
        return Connector(number, name, self.connected[number], (modeline(HD),), (70,), 70)

    def encoder(self, number: int) -> abi.GetEncoder:
        return abi.GetEncoder(encoder_id=number, crtc_id=CRTC, possible_crtcs=1)

    def planes(self) -> tuple[abi.GetPlane, ...]:
        cursor = abi.GetPlane(plane_id=CURSOR, crtc_id=CRTC, possible_crtcs=1)
        return cursor, abi.GetPlane(plane_id=PLANE, crtc_id=CRTC, possible_crtcs=1)

    NAMES = (
        "type", "FB_ID", "CRTC_ID", "CRTC_X", "CRTC_Y", "CRTC_W", "CRTC_H", "SRC_X", "SRC_Y",
        "SRC_W", "SRC_H", "MODE_ID", "ACTIVE", "rotation", "alpha", "DEGAMMA_LUT", "CTM",
        "GAMMA_LUT", "GAMMA_LUT_SIZE",
    )  # fmt: skip

    def properties(self, number: int, kind: int) -> dict[str, Property]:
        values = {"type": {PLANE: 1, CURSOR: 2}.get(number, 0), "CRTC_ID": CRTC}
        values |= {"GAMMA_LUT_SIZE": 256, "rotation": 1, "alpha": 0xFFFF, **self.left}
        names = self.NAMES if self.lut else self.NAMES[:-2]
        return {
            name: Property(100 + index, values.get(name, 0), {"Primary": 1, "Cursor": 2})
            for index, name in enumerate(names)
        }

    def blob(self, data: object) -> int:
        self.blobs += 1
        return 900 + self.blobs

    def drop_blob(self, number: int) -> None:
        self.blobs -= 1

    def commit(self, changes: dict[int, dict[int, int]], flags: int) -> None:
        self.commits.append((changes, flags))


def number(name: str) -> int:
    return 100 + PaperCard.NAMES.index(name)


def paper_output() -> tuple[Output, PaperCard]:
    card = PaperCard()
    return Output(card, card.connector(CONNECTOR)), card  # type: ignore[arg-type]


def test_the_connector_asked_for_or_the_first_with_a_display() -> None:
    card: Card = PaperCard()  # type: ignore[assignment]
    assert find_connector(card, None).name == "DP-1"
    assert find_connector(card, "HDMI-A-1").name == "HDMI-A-1"
    with pytest.raises(DeviceAbsent) as caught:
        find_connector(card, "VGA-1")
    assert caught.value.code == "PRJ-PLUG" and "HDMI-A-1, DP-1" in caught.value.remedy


def test_the_primary_plane_is_used() -> None:
    output, _ = paper_output()
    assert (output.crtc, output.plane) == (CRTC, PLANE)


def test_nothing_else_stays_on_the_screen() -> None:
    output, card = paper_output()
    output.switch_on(modeline(HD), 77)
    changes, flags = card.commits[-1]
    assert flags == abi.ATOMIC_ALLOW_MODESET
    assert changes[MIRROR] == {number("CRTC_ID"): 0}
    assert changes[CURSOR] == {number("FB_ID"): 0, number("CRTC_ID"): 0}
    assert changes[CONNECTOR] == {number("CRTC_ID"): CRTC}
    assert changes[CRTC][number("ACTIVE")] == 1
    assert changes[PLANE][number("FB_ID")] == 77
    assert changes[PLANE][number("SRC_W")] == 1280 << 16


def test_what_a_program_before_left_is_undone() -> None:
    output, card = paper_output()
    card.left = {"rotation": 4, "alpha": 0x8000}
    output = Output(card, card.connector(CONNECTOR))  # type: ignore[arg-type]
    output.switch_on(modeline(HD), 77)
    changes, _ = card.commits[-1]
    assert [changes[CRTC][number(name)] for name in ("GAMMA_LUT", "DEGAMMA_LUT", "CTM")] == [0] * 3
    assert changes[PLANE][number("rotation")] == 1 and changes[PLANE][number("alpha")] == 0xFFFF


def test_a_plane_as_it_should_be_is_left_alone() -> None:
    output, card = paper_output()
    output.switch_on(modeline(HD), 77)
    assert not {number("rotation"), number("alpha")} & set(card.commits[-1][0][PLANE])


def test_our_own_table_stays_when_the_signal_begins_anew() -> None:
    output, card = paper_output()
    output.set_curve(0.5, 1.0)
    (table,) = card.commits[-1][0][CRTC].values()
    output.switch_on(modeline(HD), 77)
    assert card.commits[-1][0][CRTC][number("GAMMA_LUT")] == table != 0


def test_a_flip_does_not_block_and_asks_for_its_time() -> None:
    output, card = paper_output()
    output.flip(78)
    assert card.commits == [
        ({PLANE: {number("FB_ID"): 78}}, abi.ATOMIC_NONBLOCK | abi.PAGE_FLIP_EVENT)
    ]


def test_modes_set_again_leave_no_blobs_behind() -> None:
    output, card = paper_output()
    for _ in range(5):
        output.switch_on(modeline(HD), 77)
        output.set_curve(0.5, 1.0)
    assert card.blobs == 2
    output.release()
    output.release()
    assert card.blobs == 0


def test_a_card_without_a_table_says_so() -> None:
    card = PaperCard()
    card.lut = False
    output = Output(card, card.connector(CONNECTOR))  # type: ignore[arg-type]
    assert not output.set_curve(0.5, 1.0) and card.commits == []


class Cards:
    """Two cards, of which the first has no display. A display says whether it answers."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.displays = {"/dev/dri/card0": [False, False], "/dev/dri/card1": [False, True]}
        self.modes = (modeline(HD),)
        self.opened: list[PaperCard] = []
        module = "hypermask_drivers.projector.kms_choice.card_paths"
        monkeypatch.setattr(module, lambda wanted: list(self.displays))

    def open(self, path: str) -> Card:
        if path not in self.displays:
            raise DeviceAbsent("PRJ-CARD", "there is no such card", "Plug it.")
        card = PaperCard(path)
        card.connected = dict(zip((CONNECTOR, MIRROR), self.displays[path], strict=True))
        self.opened.append(card)
        return card  # type: ignore[return-value]

    def choice(self, **settings: Any) -> Choice:
        return Choice(KmsSettings(**settings), VirtualClock(), self.open)

    def left_open(self) -> list[str]:
        return [card.path for card in self.opened if not card.closed]


@pytest.fixture
def cards(monkeypatch: pytest.MonkeyPatch) -> Cards:
    return Cards(monkeypatch)


def test_the_card_with_a_display_is_taken_and_the_others_are_let_go(cards: Cards) -> None:
    assert cards.choice().card().path == "/dev/dri/card1"
    assert cards.left_open() == ["/dev/dri/card1"]


def test_without_any_display_it_is_the_first_card(cards: Cards) -> None:
    cards.displays["/dev/dri/card1"] = [False, False]
    assert cards.choice().card().path == "/dev/dri/card0"
    assert cards.left_open() == ["/dev/dri/card0"]


def test_a_display_on_another_connector_than_the_one_asked_for_does_not_count(cards: Cards) -> None:
    assert cards.choice(connector="HDMI-A-1").card().path == "/dev/dri/card0"


def test_after_a_loss_card_and_connector_are_those_from_before(cards: Cards) -> None:
    choice = cards.choice()
    card = choice.card()
    choice.keep(card, choice.connector(card), modeline(HD))
    cards.displays = {"/dev/dri/card0": [True, True], "/dev/dri/card1": [True, False]}
    card = choice.card()
    assert (card.path, choice.connector(card).name) == ("/dev/dri/card1", "DP-1")
    del cards.displays["/dev/dri/card1"]
    assert choice.card().path == "/dev/dri/card0"


# The device


def test_without_a_card_it_is_absent() -> None:
    projector = KmsProjector(KmsSettings(card="/nowhere/card0"))
    with pytest.raises(DeviceAbsent) as caught:
        projector.open()
    assert caught.value.code == "PRJ-CARD"
    projector.close()


@pytest.mark.parametrize("use", ["mode", "context", "framebuffer", "next_flip_s", "present"])
def test_use_of_a_closed_projector_is_an_error(use: str) -> None:
    with pytest.raises(DeviceError) as caught:
        found = getattr(KmsProjector(), use)
        found()
    assert caught.value.code == "PRJ-CLOSED"
