"""The show worker: keys and requests in; the scene and what the head does, out.

Beside the keypad it has, where it is given them: a control socket, modes that borrow the keypad
(`workers.modes`), and the cart's slow devices (`workers.devices`). None of them holds up a key.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from hypermask.blackboard import Record
from hypermask.errors import HypermaskError, UsageError
from hypermask.face.character import check_name, find_character
from hypermask.neck.record import BEAT_S
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import ShowFile
from hypermask.workers import orders
from hypermask.workers.board import KEPT, Board
from hypermask.workers.commands import Commands
from hypermask.workers.control import ControlServer
from hypermask.workers.devices import SideDevices
from hypermask.workers.modes import HELD, Hold, ModeKeeper, Modes
from hypermask.workers.modes import Mode as Mode
from hypermask.workers.orders import ORDERS
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.clock import Clock
from hypermask_drivers.keypad import KeyEvent, Keypad

PATIENCE_S = 0.02
"""The longest wait for a key, so that requests and the neck's beat are in time."""
RESUME_S = 30.0
"""A show that died less than this ago is gone on with; an older one begins anew."""


class ShowWorker:
    """Owns the keypad, if there is one, and the slow devices; writes `Board.scene` when it starts
    and after every cue and every arrival, `Board.neck` every 0.1 s, `Board.words` and
    `Board.machine`.

    Began again after it died, it goes on with the scene that is on the board.
    """

    def __init__(
        self,
        keypad: Keypad | None,
        engine: ShowEngine,
        board: Board,
        clock: Clock,
        report: Report,
        *,
        control: ControlServer | None = None,
        modes: Modes | None = None,
        devices: SideDevices | None = None,
        reload: Callable[[], ShowFile] | None = None,
    ) -> None:
        """reload: reads the show file again, for the request `reload`."""
        self.keypad = None if keypad is None else Kept(keypad, "keypad", clock, report)
        self.engine = engine
        self._board, self._report, self._clock = board, report, clock
        self.keeper = ModeKeeper(modes or {}, board, report)
        self._hold = Hold({key: mode for key, mode in HELD.items() if mode in self.keeper.names})
        self.devices = devices or SideDevices(board, clock, report)
        self._control, self._commands = control, Commands(self)
        self._reload = reload
        self._arrived = 0
        self._beaten_s = -float("inf")
        self.latency_s: deque[float] = deque(maxlen=KEPT)  # from a key to its scene
        self._begin(clock.now())

    def step(self, timeout_s: float = 0.0) -> bool:
        """Take one key event if there is one; False when there was none."""
        now_s = self._clock.now()
        self._welcome()
        self.keeper.step(now_s)
        if self._control is not None:
            self._control.step(
                now_s, lambda request: self._commands.carry_out(request, self._clock.now())
            )
        self.devices.step(now_s)
        self._beat(now_s)
        event = self._key(min(timeout_s, PATIENCE_S))
        if event is None:
            self._nothing_pressed()
            return False
        self.devices.pressed(event.key, event.time_s)
        due = self._hold.event(event.key, event.pressed, event.time_s)
        if due is not None and due[0] == "hold":
            self.keeper.toggle(due[1], event.time_s)
        elif due is not None and self.take(event.key, event.time_s):
            self.latency_s.append(self._clock.now() - event.time_s)
        return True

    def stop(self) -> None:
        """Leave the mode, close the socket and the devices. The scene stays on the board."""
        self.keeper.close(self._clock.now())
        if self._control is not None:
            self._control.close()
        self.devices.close()
        if self.keypad is not None:
            self.keypad.device.close()

    # --- what requests may do, see `commands.Desk` --------------------------------------------

    def take(self, key: str, now_s: float) -> str | None:
        """A key, pressed at the keypad or by a request; returns the cue that it called."""
        if self.keeper.active:
            self.keeper.press(key, now_s)
            return None
        try:
            called = self.engine.press(key, now_s)
        except HypermaskError as error:  # such as a character that has not come yet
            self._report(now_s, error.code, str(error))
            return None
        if called is None:
            return None
        self.changed(called.time_s, "CUE", f"Key {key}: {called.cue}")
        return called.cue

    def changed(self, now_s: float, code: str, text: str) -> None:
        self._report(now_s, code, text)
        self._board.scene.publish(self.engine.scene)
        self._beat(now_s, at_once=True)

    def welcome(self, name: str, appear: bool = True) -> str:
        """Raises `UsageError` CHAR-NAME, `DataError` CHAR-ABSENT, `HypermaskError` DISK-WRITE."""
        folder = self._board.folder
        if folder is None:
            raise UsageError("CHAR-SHOW", f"'{name}' does not play in this show", "Name another.")
        check_name(name)
        find_character(name)
        order = orders.Order(
            name=name, character=name, appear=appear, ordered_s=max(self._clock.now(), 0.0)
        )
        orders.place(folder / ORDERS, order)
        return f"The character '{name}' was sent for and comes in a moment."

    def reload(self, now_s: float) -> str:
        """Raises what the show file's reading raises; the show then goes on as it is."""
        if self._reload is None:
            raise UsageError("CTL-RELOAD", "this show has no file to read again", "Restart it.")
        show = self._reload()
        new = self.engine.adopt(show)
        for name in new:
            self.welcome(name, appear=False)
        self.changed(now_s, "SHOW-RELOADED", f"The show file '{show.name}' was read again.")
        coming = f" New characters come in a moment: {', '.join(new)}." if new else ""
        return f"The show '{show.name}' is in use.{coming}"

    def device(self, action: str, kind: str | None, now_s: float) -> dict[str, object]:
        if action == "list" or kind is None:
            return {"devices": [self._keypad_state(), *self.devices.states()]}
        if kind == "keypad":
            return {"device": self._keypad_state(), "text": self.devices.last_key(now_s)}
        return self.devices.test(kind) if action == "test" else self.devices.probe(kind)

    def _keypad_state(self) -> dict[str, object]:
        state = "none" if self.keypad is None else self.keypad.device.state.value
        return {"kind": "keypad", "state": state}

    # --- its own turns ------------------------------------------------------------------------

    def _begin(self, now_s: float) -> None:
        """A new show, or the one that this worker died in."""
        scene, neck = self._board.scene.latest(), self._board.neck.latest()
        if scene is not None and neck is not None:
            if 0 <= now_s - float(neck["time_s"]) <= RESUME_S:
                self._resume(scene, neck, now_s)
            else:
                self.engine.after(neck)
        self._board.scene.publish(self.engine.scene)
        self._beat(now_s, at_once=True)

    def _resume(self, scene: Record, neck: Record, now_s: float) -> None:
        self.engine.resume(scene, neck)
        curtain, wardrobe = self._board.curtain.latest(), self._board.wardrobe.latest()
        if curtain is not None and wardrobe is not None:
            self._arrived = int(curtain["dressed"])
            for entry in sorted(wardrobe["costumes"], key=lambda entry: int(entry["version"])):
                if 0 < int(entry["version"]) <= self._arrived:
                    self.engine.arrive(entry["name"].decode(), False, now_s)
        self._report(now_s, "SHOW-RESUMED", "The show goes on where it was.")

    def _beat(self, now_s: float, at_once: bool = False) -> None:
        if at_once or now_s - self._beaten_s >= BEAT_S - 1e-9:
            self._board.neck.publish(self.engine.beat(now_s))
            self._beaten_s = now_s

    def _key(self, timeout_s: float) -> KeyEvent | None:
        keypad = self.keypad
        return None if keypad is None else keypad.use(lambda device: device.read(timeout_s))

    def _nothing_pressed(self) -> None:
        now_s = self._clock.now()
        if self.keypad is None or not self.keypad.ready():
            self._hold.forget()
            return
        held = self._hold.due(now_s)
        if held is not None:
            self.keeper.toggle(held, now_s)

    def _welcome(self) -> None:
        """Characters that the stage has got ready join the show."""
        curtain, wardrobe = self._board.curtain.latest(), self._board.wardrobe.latest()
        if curtain is None or wardrobe is None or int(curtain["dressed"]) <= self._arrived:
            return
        now_s, dressed = self._clock.now(), int(curtain["dressed"])
        new = [
            entry for entry in wardrobe["costumes"] if self._arrived < entry["version"] <= dressed
        ]
        for entry in sorted(new, key=lambda entry: int(entry["version"])):
            name = entry["name"].decode()
            if self.engine.arrive(name, bool(entry["appear"]), now_s):
                self._report(now_s, "CHAR-JOINS", f"The character '{name}' joins the show.")
        self._arrived = dressed
        self._board.scene.publish(self.engine.scene)
