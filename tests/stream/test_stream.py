"""A performance over a network: 10 kbit/s, and what networks do to it."""

import socket
from pathlib import Path

import numpy as np
import pytest
from stream_rig import Pair, speech

from hypermask.errors import ConfigError, HypermaskError
from hypermask.face.action_units import unit_weights
from hypermask.face.expressions import Expression
from hypermask.geometry import vector_from_rotation
from hypermask.show.scene import SCENE, show_expression, units_at
from hypermask.stream.guard import Guard, next_session
from hypermask.stream.link import UdpReceiver, UdpSender
from hypermask.stream.packet import decode
from hypermask.stream.settings import ReceiveSettings, StreamSettings, load_key, load_stream
from hypermask.tracking.motion import predict

KEY, OTHER_KEY = b"sixteen bytes !!", b"another sixteen!"
SPOKEN = np.array([speech(t) for t in np.arange(0, 60, 0.01)])
LOUDNESS = float(np.sqrt(np.mean(SPOKEN**2)))


def angry(pair: Pair) -> np.ndarray:
    units = unit_weights({"4": 0.8, "5": 0.6, "7": 0.5, "23L": 0.7})
    scene = np.zeros((), SCENE)
    show_expression(scene, Expression("angry", "", np.zeros(1), units[None]), 0, 0)
    pair.here.scene.publish(scene)
    return units


def test_it_is_off_unless_asked_for() -> None:
    settings = StreamSettings()
    assert not settings.send.on and not settings.receive.on
    assert settings.receive.host == "127.0.0.1"


@pytest.mark.parametrize(("host", "header"), [("127.0.0.1", 28), ("::1", 48)])
@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("wild", [False, True])
def test_on_the_wire_it_is_at_most_10_kbit_a_second(
    host: str, header: int, key: bytes | None, wild: bool
) -> None:
    """Real sockets; all there is to send, in every second, with all headers.

    A wild mouth, unlike any speech, gets coarser steps instead of more bits.
    """
    try:
        receiver = UdpReceiver(host, 0 or _free_port(host), [host])
    except (HypermaskError, OSError):
        pytest.skip(f"this machine has no {host}")
    link = UdpSender(host, receiver.port)
    pair = Pair(key=key, with_head=True, link=link, listening=receiver)
    units = angry(pair)
    if wild:
        random = np.random.default_rng(3)
        pair.mouth = lambda time_s: random.uniform(-1.5, 1.5, 13)
    sizes: list[tuple[float, int]] = []
    send = link.send
    link.send = lambda data: (sizes.append((pair.clock.now(), len(data))), send(data))[1]  # type: ignore[method-assign]
    pair.run(30)
    link.close()
    receiver.close()
    assert pair.receiver.received == pair.sender.sent == len(sizes) >= 374
    times, bits = np.array(sizes).T
    bits = 8 * (bits + header)
    assert max(bits[(times >= t) & (times < t + 1)].sum() for t in times) <= 10_000
    if wild:  # the face may have been left out for the mouth
        return
    scene = pair.there.scene.latest()
    assert scene is not None
    np.testing.assert_allclose(units_at(scene, pair.clock.now()), units, atol=0.02)


def _free_port(host: str) -> int:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize(("loss", "limit"), [(0.0, 0.05), (0.05, 0.09), (0.2, 0.2)])
def test_the_mouth_is_right_however_much_is_lost(loss: float, limit: float) -> None:
    pair = Pair(loss=loss, jitter_s=0.02)
    pair.run(2)
    times, mouths = pair.run(60)
    assert pair.rms(times, mouths) < limit * LOUDNESS


def test_at_a_loss_of_20_percent_it_is_still_smooth() -> None:
    """No step from one picture to the next that the performance does not make."""
    pair = Pair(loss=0.2, jitter_s=0.02)
    pair.run(2)
    _, mouths = pair.run(60)
    largest = np.abs(np.diff(SPOKEN, axis=0)).max()
    steps = np.abs(np.diff(mouths, axis=0)).max(axis=1)
    assert np.quantile(steps, 0.999) < 1.2 * largest
    assert steps.max() < 2.5 * largest


def test_reordered_and_doubled_datagrams_change_nothing() -> None:
    plain, wild = Pair(delay_s=0.01), Pair(delay_s=0.01, jitter_s=0.11, doubles=0.5)
    for pair in (plain, wild):
        pair.run(3)
    (times, first), (_, second) = plain.run(20), wild.run(20)
    assert wild.rms(times, second) < plain.rms(times, first) + 0.03
    assert wild.receiver.received == pytest.approx(wild.sender.sent, abs=3)
    assert wild.receiver.refused["again"] > 100


def test_a_stream_that_stops_closes_the_mouth_within_300_ms() -> None:
    pair = Pair()
    units = angry(pair)
    pair.mouth = lambda time_s: 0.9 * np.ones(13)
    pair.run(2)
    pair.network.down = True
    times, mouths = pair.run(0.5)
    after = times - (times[0] - 0.08)
    assert np.abs(mouths[after > 0.42]).max() == 0
    assert pair.said == ["STREAM-PLAYS", "STREAM-LOST"]
    scene = pair.there.scene.latest()
    assert units.max() > 0.5 and units_at(scene, pair.clock.now()).max() < 0.01
    pair.network.down = False
    assert np.abs(pair.run(1.0)[1][-1]).max() > 0.5
    assert pair.said[2:] == ["STREAM-PLAYS"]


def test_nothing_came_yet_and_nothing_is_published() -> None:
    pair = Pair(loss=1.0)
    pair.run(1)
    assert pair.there.mouth.latest() is None and pair.there.scene.latest() is None
    assert pair.receiver.status()["state"] == "absent"


def test_the_head_follows_the_other_s_where_it_may() -> None:
    pair = Pair(with_head=True, settings=ReceiveSettings(head=True), loss=0.1)
    pair.run(10)
    track = pair.there.track.latest()
    assert track is not None and track["locked"]
    now_s = pair.clock.now()
    pose, truth = predict(track["motion"], now_s).pose, pair.head(now_s - pair.delay_s)
    assert np.abs(pose.translation - truth.translation).max() < 0.01
    turned = vector_from_rotation(pose.rotation @ truth.rotation.T)
    assert np.linalg.norm(turned) < 0.03


def test_a_local_tracker_and_show_are_left_alone_by_default() -> None:
    pair = Pair(with_head=True)
    pair.receiver._scene = None
    angry(pair)
    pair.run(1)
    assert pair.there.track.latest() is None and pair.there.scene.latest() is None


def test_two_quartzes_100_ppm_apart_do_not_drift_apart() -> None:
    pair = Pair()
    clock = pair.clock

    class Fast:
        """The receiver's clock, 100 ppm fast."""

        def now(self) -> float:
            return 20 + clock.now() * (1 + 100e-6)

        def sleep_until(self, time_s: float) -> None:
            return

    pair.receiver._clock = Fast()
    pair.run(2)
    first = pair.rms(*pair.run(30))
    pair.run(240)
    assert pair.rms(*pair.run(30)) < first + 0.01


def test_only_who_has_the_key_is_heard() -> None:
    pair = Pair(key=KEY, receiver_key=OTHER_KEY)
    pair.run(2)
    assert pair.receiver.received == 0 and pair.said == ["STREAM-KEY"]
    for sent, heard in ((KEY, None), (None, KEY)):
        pair = Pair(key=sent)
        pair.receiver = pair.listener(heard)
        pair.run(1)
        assert pair.receiver.received == 0 and "STREAM-KEY" in pair.said


def test_a_datagram_changed_on_its_way_is_refused() -> None:
    pair = Pair(key=KEY)
    pair.run(1)
    heard = pair.receiver.received
    data = bytearray(pair.network.tapped[-1][1])
    for place in range(2, len(data)):
        changed = bytearray(data)
        changed[place] ^= 1
        pair.network.inject(bytes(changed))
    for _ in range(3):
        pair.receiver.step()
    assert pair.receiver.received == heard
    assert pair.receiver.refused["key"] == len(data) - 2


def test_a_recording_of_the_stream_is_not_played_again() -> None:
    pair = Pair(key=KEY)
    pair.run(10)
    recorded = [data for _, data in pair.network.tapped]
    pair.network.down = True
    pair.run(2)
    heard = pair.receiver.received
    for data in recorded:
        pair.network.inject(data)
        pair.run(0.08)
    assert pair.receiver.received == heard
    assert pair.receiver.status()["state"] == "lost"


def test_a_recording_is_refused_after_a_restart_too(tmp_path: Path) -> None:
    memory = tmp_path / "heard"
    guard = Guard(True, memory)
    assert guard.begins(9, "a", False) and guard.is_new(9, 800, "a")
    assert guard.is_new(9, 1600, "a")
    again = Guard(True, memory)
    assert not again.begins(8, "a", True)
    assert again.begins(9, "a", True) and not again.is_new(9, 1500, "a")
    assert again.is_new(9, 1601, "a")


def test_sessions_grow_even_where_the_clock_is_wrong(tmp_path: Path) -> None:
    memory = tmp_path / "sent"
    memory.write_text("4000000000 0\n")
    assert next_session(memory) == 4000000001
    assert next_session(memory) == 4000000002
    memory.write_text("garbage")
    assert next_session(memory) > 1_600_000_000


def test_a_sender_that_starts_anew_is_heard_at_once() -> None:
    pair = Pair(key=KEY)
    pair.run(5)
    from hypermask.workers.stream import StreamSender

    link, board, clock = pair.network, pair.here, pair.clock
    pair.sender = StreamSender(link, board, clock, pair.note, session=8, key=KEY)
    times, mouths = pair.run(5)
    assert pair.rms(times[100:], mouths[100:]) < 0.05
    assert pair.said == ["STREAM-PLAYS"]


def test_a_second_sender_does_not_take_over_while_the_first_plays() -> None:
    pair = Pair()
    pair.run(2)
    stolen = bytearray(pair.network.tapped[-1][1])
    stolen[5] += 1  # a later session
    pair.network.inject(bytes(stolen), "198.51.100.9")
    pair.run(0.05)
    assert pair.receiver.refused["session"] == 1 and "STREAM-SESSION" in pair.said
    assert pair.receiver.status()["state"] == "playing"


def test_strangers_are_not_heard() -> None:
    receiver = UdpReceiver("127.0.0.1", _free_port("127.0.0.1"), ["192.0.2.7"])
    sender = UdpSender("127.0.0.1", receiver.port)
    sender.send(b"hello")
    receiver.wait(1.0)
    assert receiver.receive() is None and receiver.strangers == 1
    sender.close()
    receiver.close()


def test_the_receiver_s_memory_is_bounded() -> None:
    pair = Pair(loss=0.1, jitter_s=0.1, with_head=True)
    angry(pair)
    pair.run(5)
    playout = pair.receiver._playout
    for _ in range(4):
        pair.run(10)
        kept = len(playout._mouths) + len(playout._units._times) + len(playout._heads._times)
        assert kept < 300
        assert len(playout._fastest) < 20


def test_a_network_that_is_away_is_said_once_and_the_stream_goes_on() -> None:
    pair = Pair()
    send = pair.network.send

    def fail(data: bytes) -> None:
        raise HypermaskError("STREAM-SEND", "no way", "Wait.")

    pair.network.send = fail  # type: ignore[method-assign]
    pair.run(2)
    pair.network.send = send  # type: ignore[method-assign]
    pair.run(1)
    assert pair.said == ["STREAM-SEND", "STREAM-SENDS", "STREAM-PLAYS"]


def test_a_sender_that_was_held_up_does_not_send_in_a_burst() -> None:
    pair = Pair()
    pair.run(1)
    pair.clock.sleep_until(pair.clock.now() + 5)
    before = pair.sender.sent
    times, mouths = pair.run(2)
    assert pair.sender.sent - before <= 26
    assert pair.rms(times[100:], mouths[100:]) < 0.05


def test_a_key_must_be_a_secret(tmp_path: Path) -> None:
    good = tmp_path / "good"
    good.write_bytes(KEY + b"\n")
    good.chmod(0o600)
    assert load_key(good) == KEY and load_key(None) is None
    short, public = tmp_path / "short", tmp_path / "public"
    short.write_bytes(b"secret")
    short.chmod(0o600)
    public.write_bytes(KEY)
    public.chmod(0o644)
    for path in (short, public, tmp_path / "none"):
        with pytest.raises(ConfigError) as caught:
            load_key(path)
        assert caught.value.code == "STREAM-KEY"


def test_its_settings_are_a_table_of_the_machine(tmp_path: Path) -> None:
    path = tmp_path / "machine.toml"
    path.write_text('[stream.send]\non = true\nhost = "stage.example"\n[sound.microphone]\n')
    assert load_stream(path).send.host == "stage.example"
    path.write_text("[stream.send]\nhots = 1\n")
    with pytest.raises(ConfigError, match="host"):
        load_stream(path)


def test_a_name_that_is_none_and_a_port_that_is_taken_are_told() -> None:
    with pytest.raises(HypermaskError) as caught:
        UdpSender("no such host", 1)
    assert caught.value.code == "STREAM-HOST"
    first = UdpReceiver("127.0.0.1", _free_port("127.0.0.1"))
    with pytest.raises(HypermaskError) as caught:
        UdpReceiver("127.0.0.1", first.port)
    assert caught.value.code == "STREAM-PORT"
    first.close()


def test_every_datagram_stands_for_itself() -> None:
    pair = Pair(with_head=True)
    angry(pair)
    pair.run(3)
    for time_s, data in pair.network.tapped[2:]:
        block = decode(data)
        truth = np.array([speech(time_s - 0.02 * k) for k in (3, 2, 1, 0)])
        assert np.abs(block.mouths - truth).max() < 0.05
        assert block.units is not None and block.head is not None and block.before is not None
