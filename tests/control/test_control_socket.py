"""The control socket answers whoever asks, and nobody who misbehaves costs the show anything."""

from __future__ import annotations

import json
import os
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest
from show_rig import Rig, read

from hypermask.errors import HypermaskError, UsageError
from hypermask.workers.control import LONGEST, MOST_CLIENTS, ControlServer, ask


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    rig = Rig(tmp_path)
    yield rig
    rig.close()


def packet(rig: Rig, data: bytes) -> dict[str, object]:
    with rig.client() as client:
        client.send(data)
        rig.run(0.02)
        return read(client)


def code_of(answer: dict[str, object]) -> str:
    error = answer["error"]
    assert isinstance(error, dict) and set(error) == {"code", "what", "remedy", "exit"}
    return str(error["code"])


def test_a_request_is_answered_and_done(rig: Rig) -> None:
    answer = rig.ask(do="cue", name="happiness")
    assert answer["ok"] and "happiness" in answer["text"]
    scene = rig.board.scene.latest()
    assert scene is not None and bytes(scene["mood"].item()) == b"happiness"


def test_only_the_owner_and_the_group_may_use_it(rig: Rig) -> None:
    assert stat.S_IMODE(rig.server.path.stat().st_mode) == 0o660


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"\xff\xfe\x00rubbish", "CTL-JSON"),
        (b'{"do": "cue", "na', "CTL-JSON"),
        (b"[1, 2]", "CTL-JSON"),
        (b'"cue"', "CTL-JSON"),
        (b"[" * 15000, "CTL-JSON"),
        (b'{"do": "danse"}', "CTL-DO"),
        (b'{"do": ["cue"]}', "CTL-DO"),
        (b'{"do": null}', "CTL-DO"),
        (b"{}", "CTL-DO"),
        (b'{"do": "cue"}', "CFG-MISSING"),
        (b'{"do": "cue", "name": 7}', "CFG-VALUE"),
        (b'{"do": "cue", "name": "wink", "loud": true}', "CFG-KEY"),
        (b'{"do": "cue", "name": "wonk"}', "CUE-NAME"),
        (b'{"do": "brightness", "level": NaN}', "CFG-VALUE"),
        (b'{"do": "brightness", "level": 1e999}', "CFG-VALUE"),
        (b'{"do": "brightness", "level": 0}', "CFG-VALUE"),
        (b'{"do": "blackout", "to": "maybe"}', "CFG-VALUE"),
        (b'{"do": "press", "key": "escape"}', "KEY-NAME"),
        (b'{"do": "gesture", "name": "dance"}', "CFG-VALUE"),
        (b'{"do": "gesture", "name": "look"}', "CTL-VALUE"),
        (b'{"do": "gesture", "name": "look", "look": [400, 0]}', "CFG-VALUE"),
        (b'{"do": "character", "name": "nobody"}', "CHAR-ABSENT"),
        (b'{"do": "character", "name": "../../etc"}', "CHAR-NAME"),
        (b'{"do": "character", "name": "a\\u0000b"}', "CHAR-NAME"),
        (b'{"do": "mode", "action": "begin", "name": "dream"}', "MODE-NAME"),
        (b'{"do": "mode", "action": "begin"}', "CTL-VALUE"),
        (b'{"do": "mode", "action": "cancel"}', "MODE-NONE"),
        (b'{"do": "mode", "action": "press", "key": "5"}', "MODE-NONE"),
        (b'{"do": "devices", "action": "probe", "kind": "oven"}', "DEV-KIND"),
        (b'{"do": "devices", "action": "probe", "kind": "camera"}', "DEV-HELD"),
        (b'{"do": "devices", "action": "test", "kind": "lamp"}', "DEV-NONE"),
        (b'{"do": "reload"}', "CTL-RELOAD"),
    ],
)
def test_what_cannot_be_meant_is_answered_with_a_code(rig: Rig, data: bytes, code: str) -> None:
    before = rig.board.scene.latest()
    assert code_of(packet(rig, data)) == code
    assert rig.board.scene.latest() == before
    assert rig.ask(do="status")["ok"]


def test_a_message_that_is_too_long_is_refused(rig: Rig) -> None:
    assert code_of(packet(rig, b'{"do": "' + b"x" * LONGEST + b'"}')) == "CTL-SIZE"


def test_a_megabyte_of_rubbish_costs_nothing(rig: Rig) -> None:
    with rig.client() as rude:
        for _ in range(64):
            try:
                rude.send(os.urandom(LONGEST + 17))
            except BlockingIOError:
                rig.run(0.01)
        rig.run(0.5)
        assert rig.ask(do="status")["ok"]


def test_a_client_that_never_reads_is_dropped_and_others_are_served(rig: Rig) -> None:
    with rig.client() as rude:
        dropped = False
        for _ in range(20_000):
            try:
                rude.send(b'{"do": "cues"}')
            except BlockingIOError:
                rig.worker.step()
            except (BrokenPipeError, ConnectionError):
                dropped = True
                break
        assert dropped, "its answers fill the kernel's memory for ever"
        assert rig.ask(do="status")["ok"]
        assert rig.server.clients <= 1


def test_one_that_asks_all_the_time_does_not_keep_others_out(rig: Rig) -> None:
    polite = rig.client()
    rig.run(0.05)
    rude = [rig.client() for _ in range(20)]
    for number in range(10):
        for client in rude:
            client.send(b'{"do": "status"}')
        if number == 5:
            polite.send(b'{"do": "status"}')
        rig.run(0.01)
    assert read(polite)["ok"]
    for client in (*rude, polite):
        client.close()


def test_a_hundred_silent_clients_leave_room_for_the_technician(rig: Rig) -> None:
    crowd = []
    for _ in range(100):
        try:
            crowd.append(rig.client())
        except BlockingIOError:
            rig.run(0.05)
            crowd.append(rig.client())
    rig.run(0.3)
    assert rig.server.clients <= MOST_CLIENTS
    assert rig.ask(do="cue", name="wink")["ok"]
    for client in crowd:
        client.close()
    rig.run(0.1)
    assert rig.server.clients == 0


def test_a_client_that_says_nothing_is_let_go(rig: Rig) -> None:
    with rig.client():
        rig.run(0.1)
        assert rig.server.clients == 1
        rig.run(31.0)
        assert rig.server.clients == 0


def test_a_client_that_hangs_up_before_its_answer(rig: Rig) -> None:
    client = rig.client()
    client.send(b'{"do": "cue", "name": "anger"}')
    client.close()
    rig.run(0.05)
    scene = rig.board.scene.latest()
    assert scene is not None and bytes(scene["mood"].item()) == b"anger"
    assert rig.server.clients == 0


def test_keys_are_taken_while_the_socket_is_flooded(rig: Rig) -> None:
    rig.run(0.02)
    crowd = [rig.client() for _ in range(30)]
    rig.keypad.press("5")
    began_s = rig.clock.now()
    for client in crowd:
        client.send(b"{")
    rig.run(0.01)
    assert ("CUE", "Key 5: happiness") in rig.told and rig.clock.now() - began_s < 0.05
    for client in crowd:
        client.close()


def test_a_fault_in_the_handler_is_an_answer(tmp_path: Path) -> None:
    server = ControlServer(tmp_path / "sock")

    def broken(request: dict[str, object]) -> dict[str, object]:
        raise ZeroDivisionError("oh")

    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as client:
        client.connect(str(server.path))
        client.send(b"{}")
        assert server.step(0.0, broken) == 1
        assert json.loads(client.recv(9999))["error"]["code"] == "CTL-FAULT"
    server.close()


def test_the_socket_of_a_killed_show_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    dead = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    dead.bind(str(path))
    dead.close()
    ControlServer(path).close()
    assert not path.exists()


def test_a_second_show_does_not_take_the_first_ones_socket(rig: Rig) -> None:
    with pytest.raises(HypermaskError) as caught:
        ControlServer(rig.server.path)
    assert caught.value.code == "CTL-BUSY"
    assert rig.ask(do="status")["ok"]


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(HypermaskError) as caught:
        ControlServer(tmp_path / "file" / "control.sock")
    assert caught.value.code == "CTL-SOCKET"


def test_without_a_show_the_client_says_so(tmp_path: Path) -> None:
    with pytest.raises(HypermaskError, match=r"CTL-NONE.*systemctl start"):
        ask({"do": "status"}, tmp_path / "none")


def test_a_show_that_does_not_answer_is_told(tmp_path: Path) -> None:
    deaf = ControlServer(tmp_path / "sock")
    with pytest.raises(HypermaskError, match="CTL-SILENT"):
        ask({"do": "status"}, tmp_path / "sock", timeout_s=0.01)
    deaf.close()


def test_the_client_raises_what_the_show_refused(tmp_path: Path) -> None:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(str(tmp_path / "sock"))
    listener.listen(1)

    def answered(answer: bytes) -> BaseException:
        import threading

        def serve() -> None:
            client, _ = listener.accept()
            client.recv(9999)
            client.send(answer)
            client.close()

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            with pytest.raises(HypermaskError) as caught:
                ask({"do": "cue", "name": "x"}, tmp_path / "sock")
            return caught.value
        finally:
            thread.join()

    refused = answered(
        b'{"ok": false, "error": {"code": "CUE-NAME", "what": "w", "remedy": "r", "exit": 2}}'
    )
    assert isinstance(refused, UsageError) and str(refused) == "CUE-NAME: w. r"
    fault = answered(b'{"error": {"code": "DISK-WRITE", "what": "w", "remedy": "r", "exit": 1}}')
    assert not isinstance(fault, UsageError)
    assert getattr(answered(b"half an ans"), "code", "") == "CTL-JSON"
    assert getattr(answered(b"[]"), "code", "") == "CTL-JSON"
    listener.close()
