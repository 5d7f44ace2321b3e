"""Two hypermasks and a bad network between them, under a virtual clock."""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np

from hypermask.face.mouth import MOUTH_SHAPES
from hypermask.geometry import FACING, Pose, rotation_from_vector
from hypermask.show.scene import SCENE
from hypermask.stream.settings import ReceiveSettings
from hypermask.tracking.motion import MotionFilter
from hypermask.workers.board import MOUTH, TRACK, Board
from hypermask.workers.stream import StreamReceiver, StreamSender
from hypermask_drivers.clock import VirtualClock

SHAPES = np.array([MOUTH_SHAPES[name] for name in "aiueo"])


def speech(time_s: float) -> np.ndarray:
    """A mouth that speaks five syllables a second, with pauses, through all vowels."""
    weights = np.array(
        [max(np.sin(2 * np.pi * (0.9 + 0.35 * k) * time_s + 2 * k), 0) ** 2 for k in range(5)]
    )
    loud = 0.5 - 0.5 * np.cos(2 * np.pi * 5 * time_s)
    speaks = np.clip(3 * np.sin(2 * np.pi * time_s / 7) + 1.5, 0, 1)
    return speaks * loud * (weights @ SHAPES) / max(weights.sum(), 1)


class Network:
    """A link with loss, delay, jitter (seconds), doubles and a tap."""

    largest = 68

    def __init__(
        self,
        clock: VirtualClock,
        loss: float = 0.0,
        delay_s: float = 0.03,
        jitter_s: float = 0.0,
        doubles: float = 0.0,
        seed: int = 1,
    ) -> None:
        self.clock, self.loss, self.delay_s, self.jitter_s = clock, loss, delay_s, jitter_s
        self.doubles, self.random = doubles, np.random.default_rng(seed)
        self.tapped: list[tuple[float, bytes]] = []
        self.down = False
        self._coming: list[tuple[float, int, bytes, str]] = []
        self._count = 0

    def send(self, data: bytes) -> None:
        self.tapped.append((self.clock.now(), data))
        for _ in range(1 + int(self.random.random() < self.doubles)):
            if not self.down and self.random.random() >= self.loss:
                late_s = self.delay_s + self.jitter_s * self.random.random()
                self.inject(data, "192.0.2.1", late_s)

    def inject(self, data: bytes, address: str = "192.0.2.1", after_s: float = 0.0) -> None:
        self._count += 1
        heapq.heappush(self._coming, (self.clock.now() + after_s, self._count, data, address))

    def receive(self) -> tuple[bytes, str] | None:
        if not self._coming or self._coming[0][0] > self.clock.now():
            return None
        return heapq.heappop(self._coming)[2:]

    def wait(self, seconds: float) -> None:
        return


class Pair:
    """sender.board -> network -> receiver.board; speaks `mouth`, moves as `head`."""

    def __init__(
        self,
        key: bytes | None = None,
        receiver_key: bytes | None = None,
        settings: ReceiveSettings | None = None,
        with_head: bool = False,
        link: object = None,
        listening: object = None,
        **network: float,
    ) -> None:
        self.clock = VirtualClock(500.0)
        self.network = Network(self.clock, **network)  # type: ignore[arg-type]
        self.here, self.there = Board.local(), Board.local()
        self.said: list[str] = []
        self.settings = settings or ReceiveSettings()
        self.mouth: Callable[[float], np.ndarray] = speech
        self.with_head = with_head
        self._motion = MotionFilter()
        self.sender = StreamSender(
            link or self.network, self.here, self.clock, self.note, session=7, key=key
        )
        self.receiver = self.listener(receiver_key or key, listening)

    def listener(self, key: bytes | None, link: object = None) -> StreamReceiver:
        scene = np.zeros((), SCENE)
        return StreamReceiver(
            link or self.network, self.there, self.clock, self.note, self.settings, key,
            scene=scene,
        )  # type: ignore[arg-type]  # fmt: skip

    def note(self, time_s: float, code: str, text: str) -> None:
        self.said.append(code)

    def perform(self) -> None:
        now_s = self.clock.now()
        record = np.zeros((), MOUTH)
        record["time_s"], record["parameters"], record["level_db"] = now_s, self.mouth(now_s), -20
        self.here.mouth.publish(record)
        if self.with_head:
            self._motion.update(now_s, self.head(now_s), np.eye(6) * 1e-8)
            track = np.zeros((), TRACK)
            track["motion"], track["seen_s"], track["locked"] = self._motion.record(), now_s, True
            self.here.track.publish(track)

    def head(self, time_s: float) -> Pose:
        turn = rotation_from_vector([0.1, 0.5 * np.sin(1.5 * time_s), 0.1 * np.cos(2 * time_s)])
        return Pose(turn @ FACING, np.array([0.3 * np.sin(time_s), 0.1, 2.0]))

    def run(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """(times, mouths (n, 13)) of what is on the other board, every 10 ms."""
        times, mouths = [], []
        for _ in range(round(seconds * 100)):
            self.clock.sleep_until(self.clock.now() + 0.01)
            self.perform()
            self.sender.step()
            self.receiver.step()
            record = self.there.mouth.latest()
            times.append(self.clock.now())
            mouths.append(np.zeros(13) if record is None else record["parameters"].copy())
        return np.array(times), np.array(mouths)

    @property
    def delay_s(self) -> float:
        """From performance to play; what comes between two looks waits for the next."""
        look_s = 0.01 if self.network.jitter_s else 0.0
        return self.network.delay_s + look_s + self.settings.buffer_ms * 1e-3

    def rms(self, times: np.ndarray, mouths: np.ndarray) -> float:
        """Of the difference to what was performed `delay_s` before."""
        truth = np.array([self.mouth(time_s - self.delay_s) for time_s in times])
        return float(np.sqrt(np.mean((mouths - truth) ** 2)))
