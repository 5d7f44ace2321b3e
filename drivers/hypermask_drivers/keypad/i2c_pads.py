"""Matrix keypads on I2C: a PCF8574 port expander that is scanned, a TCA8418 that scans itself."""

from __future__ import annotations

from collections import deque

from pydantic import Field, field_validator

from hypermask_drivers.clock import Clock, RealClock, VirtualClock
from hypermask_drivers.i2c import Connect, I2cHardware
from hypermask_drivers.keypad import KEYS, KeyEvent, Keypad
from hypermask_drivers.keypad.layout import MATRIX_4X4
from hypermask_drivers.keypad.matrix import Matrix, Scan
from hypermask_drivers.settings import Settings

_SCAN_S = 0.005


class MatrixSettings(Settings):
    """layout: rows of keys; "" where there is none. debounce_s: for the PCF8574 only."""

    device: str = "/dev/hypermask/i2c"
    address: int | None = Field(None, ge=0x08, le=0x77)
    layout: tuple[tuple[str, ...], ...] = MATRIX_4X4
    debounce_s: float = Field(0.015, ge=0, le=0.2)

    @field_validator("layout")
    @classmethod
    def _keys_exist(cls, layout: tuple[tuple[str, ...], ...]) -> tuple[tuple[str, ...], ...]:
        unknown = [key for row in layout for key in row if key and key not in KEYS]
        if unknown:
            raise ValueError(f"there is no key '{unknown[0]}'; keys: {', '.join(KEYS)}")
        if not layout or len(layout) > 8 or max(map(len, layout)) > 10:
            raise ValueError("1 to 8 rows of at most 10 keys")
        return layout


class _MatrixPad(I2cHardware, Keypad):
    code, noun = "KEY", "I2C keypad"
    _default_address: int

    def __init__(
        self,
        settings: MatrixSettings | None = None,
        clock: Clock | None = None,
        connect: Connect | None = None,
    ) -> None:
        self.settings = settings or MatrixSettings()
        address = self.settings.address or self._default_address
        super().__init__(self.settings.device, address, connect)
        self._clock = clock or RealClock()
        self._events: deque[KeyEvent] = deque()

    def poll(self) -> None:
        """Look at the keys once. Raises `DeviceLost` KEY-LOST."""
        raise NotImplementedError

    def read(self, timeout_s: float) -> KeyEvent | None:
        deadline = self._clock.now() + timeout_s
        while True:
            self.poll()
            if self._events:
                return self._events.popleft()
            now = self._clock.now()
            if now >= deadline or isinstance(self._clock, VirtualClock):
                return None
            self._clock.sleep_until(min(deadline, now + _SCAN_S))


class Pcf8574Pad(_MatrixPad):
    """Rows on P4 to P7, columns on P0 to P3 of a PCF8574 (datasheet SCPS068, section 8.3: an
    output that is high is weak and is read back as what it is pulled to).

    It has no memory: what happens between two looks that are further apart than a press lasts is
    never seen. `read` with a timeout looks every 5 ms.
    """

    _default_address = 0x20
    _IDLE = 0x0F  # all rows low: any key pulls its column low

    def _begin(self) -> None:
        rows, columns = len(self.settings.layout), max(map(len, self.settings.layout))
        if rows > 4 or columns > 4:
            self._absent("LAYOUT", "a PCF8574 takes 4 rows of 4 keys", "Correct the layout.")
        self._chip.write_byte(self._address, self._IDLE)
        self._matrix = Matrix(self.settings.layout, self.settings.debounce_s)
        self._events = self._matrix.events

    def poll(self) -> None:
        with self._talking() as bus:
            if bus.read_byte(self._address) & 0xF0:  # after power-up all of its pins are high
                self._was_reset()
            scan = tuple(self._columns(row) for row in range(len(self.settings.layout)))
            bus.write_byte(self._address, self._IDLE)
        self._matrix.take(scan, self._clock.now())

    def _columns(self, row: int) -> int:
        self._chip.write_byte(self._address, 0xFF & ~(0x10 << row))
        return ~self._chip.read_byte(self._address) & 0x0F


class Tca8418Pad(_MatrixPad):
    """TCA8418 keypad scan chip (datasheet SCPS215, section 8.6): it debounces, rejects ghosts and
    keeps ten events. Key number = 10 * row + column + 1."""

    _default_address = 0x34
    CFG, INT_STAT, KEY_LCK_EC, KEY_EVENT_A = 0x01, 0x02, 0x03, 0x04
    KP_GPIO = (0x1D, 0x1E, 0x1F)
    _CFG_OVERFLOW = 0x20  # OVR_FLOW_M: a full memory drops its oldest event, not its newest
    _OVERFLOWN = 0x08
    _MEMORY = 10

    def _begin(self) -> None:
        rows, columns = len(self.settings.layout), max(map(len, self.settings.layout))
        self._pins = ((1 << rows) - 1, (1 << min(columns, 8)) - 1, (1 << max(0, columns - 8)) - 1)
        for register, value in zip(self.KP_GPIO, self._pins, strict=True):
            self._chip.write_byte_data(self._address, register, value)
        self._chip.write_byte_data(self._address, self.CFG, self._CFG_OVERFLOW)
        if self._configured() != self._pins:
            self._absent("STRANGE", f"what answers at {self.place} is no TCA8418", "Check it.")
        for _ in range(self._MEMORY):  # what was pressed before now is nobody's business
            self._chip.read_byte_data(self._address, self.KEY_EVENT_A)
        self._chip.write_byte_data(self._address, self.INT_STAT, 0x1F)
        self._events, self._down = deque(), list[str]()

    def _configured(self) -> Scan:
        return tuple(self._chip.read_byte_data(self._address, one) for one in self.KP_GPIO)

    def poll(self) -> None:
        with self._talking() as bus:
            if self._configured() != self._pins:
                self._was_reset()
            if bus.read_byte_data(self._address, self.INT_STAT) & self._OVERFLOWN:
                self._events.extend(self._let_go())
                bus.write_byte_data(self._address, self.INT_STAT, self._OVERFLOWN)
            count = bus.read_byte_data(self._address, self.KEY_LCK_EC) & 0x0F
            for _ in range(min(count, self._MEMORY)):
                self._take(bus.read_byte_data(self._address, self.KEY_EVENT_A))

    def _let_go(self) -> list[KeyEvent]:
        """Events were lost: no key may seem to be held for ever."""
        held, self._down = self._down, []
        return [KeyEvent(key, False, self._clock.now()) for key in held]

    def _take(self, event: int) -> None:
        number, pressed = event & 0x7F, bool(event & 0x80)
        row, column = divmod(number - 1, 10)
        layout = self.settings.layout
        if number == 0 or row >= len(layout) or column >= len(layout[row]):
            return
        key = layout[row][column]
        if not key or (key in self._down) == pressed:
            return
        if pressed:
            self._down.append(key)
        else:
            self._down.remove(key)
        self._events.append(KeyEvent(key, pressed, self._clock.now()))
