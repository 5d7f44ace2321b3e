"""What is taken out of a text by its form, and what because it is this machine's own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hypermask.technician.redact import Redactor, own_words


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("12:34:56 tracker MASK-FOUND: The mask is seen.", None),
        ("The character 'kabuki' joins the show.", None),
        ("The character 'Bobby' joins the show.", "The character '[name]' joins the show."),
        ("PTU-LOST at /dev/hypermask/ptu, port 1-1.2", None),
        ("1280x720@60, 0x1b, 52 degrees C, 99.97 %", None),
        ("Key 5: happiness", None),
        ("at /dev/v4l/by-id/usb-Acme_Cam_A1B2C3-video-index0", "at /dev/v4l/by-id/[serial]"),
        ("/home/bob/show.toml", "/home/[user]/show.toml"),
        ("http://bob:pw@example/x", "http://[user]@example/x"),
        ('{"api_key": "abc", "cue": "wink"}', '{"api_key": [secret], "cue": "wink"}'),
        ("Authorization: Bearer abcdefghijkl", "Authorization: [secret] abcdefghijkl"),
        ("password = two words\n", "password = [secret] words\n"),
    ],
)
def test_by_form(text: str, left: str | None) -> None:
    assert Redactor()(text) == (text if left is None else left)


def test_common_words_of_this_machine_do_not_take_texts_apart() -> None:
    clean = Redactor({"hypermask": "[host]", "a": "[user]", "box7": "[host]"})
    assert clean("hypermask on a cart called BOX7, not box77") == (
        "hypermask on a cart called [host], not box77"
    )


def test_the_shortest_name_is_a_name() -> None:
    clean = Redactor({"Jo": "[character-1]", "Al": "[voice-1]"})
    assert clean("Jo and Al: jo, al and Jones") == "[character-1] and [voice-1]: jo, al and Jones"


def test_what_is_no_number_is_none_in_json() -> None:
    assert Redactor().json({"a": [float("inf"), 1.5]}) == json.dumps({"a": [None, 1.5]}, indent=1)


def test_the_values_are_found_on_the_machine(tmp_path: Path) -> None:
    files = {
        "etc/hostname": "stage-left\n",
        "sys/bus/usb/devices/1-1/serial": "ABCDE12345\n",
        "proc/device-tree/serial-number": "10000000deadbeef\0",
        "etc/NetworkManager/system-connections/Foyer.nmconnection":
            "[wifi]\nssid=Foyer Guests\n[wifi-security]\npsk=let me in 99\n",
        "etc/wpa_supplicant/wpa_supplicant.conf": 'network={\n ssid="Loge"\n psk="opensesame"\n}\n',
    }  # fmt: skip
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    words = own_words(tmp_path)
    for value in ("stage-left", "ABCDE12345", "10000000deadbeef", "Foyer Guests", "let me in 99",
                  "Loge", "opensesame"):  # fmt: skip
        assert value in words, value
