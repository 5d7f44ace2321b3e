"""The cart's slow devices: the projector's lamp, the battery, the processor's heat, hung USB.

They have a slow loop of their own beside the keys: at most one thing is under way at a time, and
it is under way in the background. All that is known is on `Board.machine`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hypermask.errors import HypermaskError, UsageError
from hypermask.show.scene import brightness_at
from hypermask.workers.alarms import Alarms
from hypermask.workers.background import Action, Background, OneThread
from hypermask.workers.board import MACHINE, Board
from hypermask.workers.retry import Kept, Report
from hypermask.workers.thermal import (
    CAPPED,
    COOL_C,
    HOT_C,
    THROTTLED,
    UNDER_VOLTAGE,
    Heat,
    words_of,
)
from hypermask_drivers import usb
from hypermask_drivers.clock import Clock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.lamp import Lamp, LampState
from hypermask_drivers.power import Power, PowerReading

READ_S = 2.0
HEAT_S = 5.0
USB_LOOK_S = 1.0
USB_AGAIN_S = 60.0
"""A device that hangs is made to start anew at most this often."""
STUCK_S = 10.0
TEST_S, TEST_LIGHT = 1.5, 0.3
HUNG = {"CAM-HUNG": "camera", "PTU-SILENT": "pantilt"}
"""Codes of a device that is there and does not answer, and its kind."""
OTHERS = ("camera", "projector", "pantilt", "sound")

Table = dict[str, Any]
_STUCK = HypermaskError(
    "DEV-STUCK",
    f"a device has not answered for {STUCK_S:.0f} s",
    "Check the wires of the I2C bus; the show goes on without its slow devices.",
)


@dataclass(frozen=True)
class UsbCare:
    """faults: the code that each worker's device suffers from just now, by the worker's name;
    nodes: kind -> the device's stable name; restart: port of a node -> how it was done."""

    faults: Callable[[], Mapping[str, str]]
    nodes: Mapping[str, str]
    restart: Callable[[str], str] = lambda node: _restart(node)


def _restart(node: str) -> str:
    port = usb.port_of(Path(node))
    usb.reenumerate(port)
    return port


class SideDevices:
    """Devices that are None are not in this machine. `step` never waits and never raises."""

    def __init__(
        self,
        board: Board,
        clock: Clock,
        report: Report,
        *,
        lamp: Lamp | None = None,
        power: Power | None = None,
        usb_care: UsbCare | None = None,
        heat: Callable[[], Heat] | None = None,
        light: float = 1.0,
        background: Background | None = None,
    ) -> None:
        """light: the lamp's brightness, 0 to 1; heat: `thermal.read_heat`, None not to look."""
        self._board, self._clock = board, clock
        self._alarms = Alarms(report)
        self._lamp = None if lamp is None else Kept(lamp, "lamp", clock, self._alarms.tell)
        self._power = None if power is None else Kept(power, "power", clock, self._alarms.tell)
        self._usb, self._heat = usb_care, heat
        self._light = light
        self._background = background or OneThread()
        self._record = np.zeros((), MACHINE)
        self._record["power"] = b"none" if power is None else b"lost"
        self._record["lamp"] = b"none" if lamp is None else b"lost"
        for name in ("volts", "amps", "charge", "lamp_c", "temperature_c"):
            self._record[name] = math.nan
        self._applied: tuple[bool, float] | None = None
        self._test_until_s = -math.inf
        self._due = dict.fromkeys(("lamp", "power", "heat", "usb", "publish"), -math.inf)
        self._restarted: dict[str, float] = {}
        self._begun_s = -math.inf
        self._readings: dict[str, object] = {}

    def step(self, now_s: float) -> None:
        """Begin the next thing that is due, tell what is new, publish."""
        self._alarms.flush()
        if self._background.busy:
            if now_s - self._begun_s > STUCK_S:
                self._alarms.once("stuck", _STUCK, now_s)
        else:
            self._alarms.forget("stuck")
            action = self._next(now_s)
            if action is not None:
                self._begun_s = now_s
                self._background.start(lambda: self._guarded(action))
            self._alarms.flush()
        if now_s >= self._due["publish"]:
            self._due["publish"] = now_s + 1.0
            self._publish(now_s)

    def _guarded(self, action: Action) -> None:
        """A fault of a driver must end neither the thread nor the show."""
        try:
            action()
        except Exception as error:
            text = f"a slow device's driver failed ({type(error).__name__}: {error})"
            fault = HypermaskError("DEV-FAULT", text, "Send us the bundle (hypermask bundle).")
            self._alarms.once("fault", fault, self._clock.now())

    def pressed(self, key: str, time_s: float) -> None:
        """For the status: which key was last seen."""
        self._record["key"], self._record["key_s"] = key.encode(), time_s

    def close(self) -> None:
        """Let go of the devices; the lamp stays as it is: the stage goes black by itself."""
        if self._background.busy:  # its thread ends with the process
            return
        for kept in (self._lamp, self._power):
            if kept is not None:
                kept.device.close()

    # --- what the technician asks for ---------------------------------------------------------

    def states(self) -> list[Table]:
        return [
            {"kind": kind, "state": kept.device.state.value}
            for kind, kept in (("lamp", self._lamp), ("power", self._power))
            if kept is not None
        ]

    def probe(self, kind: str) -> Table:
        """What was last read. Raises `UsageError` DEV-KIND, DEV-HELD, `HypermaskError` DEV-NONE."""
        kept = self._kept(kind)
        state = next(item for item in self.states() if item["kind"] == kind)
        reading = self._readings.get(kind)
        if kept.device.state is not DeviceState.READY or reading is None:
            return {"device": state, "text": f"The {kind} is not there; it is asked for."}
        return {"device": state, "text": _in_words(reading)}

    def test(self, kind: str) -> Table:
        """As `probe`; and the lamp is dimmed for a moment, so that it can be seen."""
        answer = self.probe(kind)
        if kind == "lamp":
            self._test_until_s = self._clock.now() + TEST_S
            answer["text"] += f" It is dimmed for {TEST_S} s: look at the picture."
        return answer

    def last_key(self, now_s: float) -> str:
        key = bytes(self._record["key"].item()).decode()
        if not key:
            return "No key was pressed yet: press one and ask again."
        return f"Last key: {key}, {now_s - float(self._record['key_s']):.1f} s ago."

    def _kept(self, kind: str) -> Kept[Any]:
        known: dict[str, Kept[Any] | None] = {"lamp": self._lamp, "power": self._power}
        if kind in OTHERS:
            raise HypermaskError(
                "DEV-HELD",
                f"the {kind} belongs to another worker while the show runs",
                "Its figures are in `hypermask status`; to test it, stop the show first.",
            )
        if kind not in known:
            raise UsageError("DEV-KIND", f"there is no kind of device '{kind}'", "See the list.")
        kept = known[kind]
        if kept is None:
            raise HypermaskError(
                "DEV-NONE", f"this machine has no {kind}", "Name one in the machine's file."
            )
        return kept

    # --- the loop -------------------------------------------------------------------------------

    def _next(self, now_s: float) -> Action | None:
        if self._lamp is not None and self._wanted(now_s) != self._applied and self._lamp_free():
            return self._set_lamp
        turns: dict[str, tuple[bool, Action, float]] = {
            "lamp": (self._lamp is not None, self._read_lamp, READ_S),
            "power": (self._power is not None, self._read_power, READ_S),
            "heat": (self._heat is not None, self._read_heat, HEAT_S),
            "usb": (self._usb is not None, self._look_at_usb, USB_LOOK_S),
        }
        there = [name for name, turn in turns.items() if turn[0] and now_s >= self._due[name]]
        if not there:
            return None
        name = min(there, key=lambda name: self._due[name])
        self._due[name] = now_s + turns[name][2]
        return turns[name][1]

    def _lamp_free(self) -> bool:
        """A lamp that is away or refuses is asked with its readings, not at every step."""
        assert self._lamp is not None
        fine = self._lamp.device.state is DeviceState.READY
        return fine and self._readings.get("lamp") is not None

    def _wanted(self, now_s: float) -> tuple[bool, float]:
        """Dark once a blackout's fade is over: a picture element lets some light through."""
        if now_s < self._test_until_s:
            return True, TEST_LIGHT * self._light
        scene = self._board.scene.latest()
        dark = scene is not None and scene["brightness"] == 0 and not brightness_at(scene, now_s)
        return not dark, self._light

    def _set_lamp(self) -> None:
        assert self._lamp is not None
        on, light = self._wanted(self._clock.now())

        def tell(lamp: Lamp) -> bool:
            if self._applied is None or self._applied[1] != light:
                lamp.set_brightness(light)
            lamp.set_power(on)
            return True

        done = self._lamp.use(tell)
        self._applied = (on, light) if done else None
        if not done:
            self._readings.pop("lamp", None)  # asked again with the next reading

    def _read_lamp(self) -> None:
        assert self._lamp is not None
        state = self._lamp.use(lambda lamp: lamp.read())
        self._record["lamp"] = b"lost" if state is None else b"ready"
        if state is None:
            self._applied = None
            self._readings.pop("lamp", None)
            return
        self._readings["lamp"] = state
        self._record["lamp_on"] = state.on
        self._record["lamp_c"] = math.nan if state.temperature_c is None else state.temperature_c
        faults = ", ".join(state.faults)
        self._record["lamp_faults"] = faults.encode()[:96]
        self._alarm(
            "lamp", faults, "LMP-FAULT", f"the projector says that {faults}",
            "Switch it off and on; if it stays, have it repaired",
            ("LMP-FINE", "The projector has no faults any more."),
        )  # fmt: skip

    def _read_power(self) -> None:
        assert self._power is not None
        reading = self._power.use(lambda power: power.read())
        self._record["power"] = b"lost" if reading is None else b"ready"
        if reading is None:
            self._readings.pop("power", None)
            return
        self._readings["power"] = reading
        self._record["volts"], self._record["amps"] = reading.voltage_v, reading.current_a
        self._record["charge"] = math.nan if reading.charge is None else reading.charge
        self._record["level"] = reading.level.encode()
        low = reading.level if reading.level in ("low", "critical") else ""
        left = "" if reading.charge is None else f", {reading.charge:.0%} left"
        self._alarm(
            "power", low, f"PWR-{low.upper()}",
            f"the battery is {low} ({reading.voltage_v:.1f} V{left})",
            "Change it now" if low == "critical" else "Change it soon",
            ("PWR-GOOD", "The battery is good again."),
        )  # fmt: skip

    def _read_heat(self) -> None:
        assert self._heat is not None
        heat = self._heat()
        self._record["temperature_c"] = heat.temperature_c
        self._record["throttled"] = heat.flags & 0xFFFFFFFF
        self._record["throttling_known"] = heat.known
        limit = COOL_C if self._alarms.is_on("hot") else HOT_C
        self._alarm(
            "hot", "hot" if heat.temperature_c >= limit else "", "TMP-HOT",
            f"the processor has {heat.temperature_c:.0f} degrees C",
            "Free its vents, look at its fan",
            ("TMP-FINE", "The processor is cool enough again."),
        )  # fmt: skip
        self._alarm(
            "slow", "slow" if heat.now & (THROTTLED | CAPPED) else "", "TMP-THROTTLED",
            f"the processor is {words_of(heat.now)}: frames may be late",
            "Cool it, and look at its supply",
            ("TMP-UNTHROTTLED", "The processor runs at its full clock again."),
        )  # fmt: skip
        self._alarm(
            "weak", "weak" if heat.now & UNDER_VOLTAGE else "", "PWR-UNDERVOLTAGE",
            "the computer's supply voltage is too low",
            "Use a stronger supply and a short cable",
            ("PWR-VOLTAGE-FINE", "The supply voltage is good again."),
        )  # fmt: skip

    def _alarm(
        self, what: str, fault: str, code: str, text: str, remedy: str, over: tuple[str, str]
    ) -> None:
        error = HypermaskError(code, text, f"{remedy}.")
        self._alarms.watch(what, fault, error, over, self._clock.now())

    def _look_at_usb(self) -> None:
        assert self._usb is not None
        now_s = self._clock.now()
        for code in self._usb.faults().values():
            kind = HUNG.get(code)
            node = self._usb.nodes.get(kind) if kind else None
            if kind is None or node is None:
                continue
            if now_s - self._restarted.get(kind, -math.inf) < USB_AGAIN_S:
                continue
            self._restarted[kind] = now_s
            self._restart(kind, node, code, now_s)

    def _restart(self, kind: str, node: str, code: str, now_s: float) -> None:
        assert self._usb is not None
        try:
            port = self._usb.restart(node)
        except HypermaskError as error:
            self._alarms.once(f"usb-{kind}", error, now_s)
            return
        self._alarms.forget(f"usb-{kind}")
        self._record["usb_resets"] += 1
        self._alarms.tell(
            now_s, "USB-RESET", f"The {kind} at USB port {port} was made to start anew ({code})."
        )

    def _publish(self, now_s: float) -> None:
        self._record["time_s"] = now_s
        self._board.machine.publish(self._record)


def _in_words(reading: object) -> str:
    if isinstance(reading, LampState):
        heat = "" if reading.temperature_c is None else f", {reading.temperature_c:.0f} degrees C"
        faults = f"; faults: {', '.join(reading.faults)}" if reading.faults else ""
        word = "on" if reading.on else "off"
        return f"The lamp is {word}, light {reading.brightness:.0%}{heat}{faults}."
    assert isinstance(reading, PowerReading)
    left = "" if reading.charge is None else f", {reading.charge:.0%} left"
    return f"{reading.voltage_v:.2f} V, {reading.current_a:.2f} A{left}, {reading.level}."
