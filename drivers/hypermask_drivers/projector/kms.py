"""A projector on a video connector, driven through the kernel (DRM/KMS) without a window system.

Source: the kernel's documentation "Kernel Mode Setting (KMS)"; FACTS measured: atomic commits that
do not block, page-flip events on CLOCK_MONOTONIC.
"""

from __future__ import annotations

import contextlib
import errno
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

import moderngl

from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import ConfigError, DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.projector import Projector, ProjectorMode
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.drm_card import RETRIED, Card, Flip, commit_error
from hypermask_drivers.projector.drm_modes import rate_hz
from hypermask_drivers.projector.gbm import Front, Screen
from hypermask_drivers.projector.kms_choice import Choice
from hypermask_drivers.projector.kms_console import force_connector, silence_console
from hypermask_drivers.projector.kms_hotplug import HotplugWatch
from hypermask_drivers.projector.kms_output import Output
from hypermask_drivers.projector.kms_pacing import FlipGrid

if TYPE_CHECKING:
    from hypermask_drivers.projector.kms_settings import KmsSettings

_log = logging.getLogger(__name__)

_FLIP_TIMEOUT_S = 1.0
_AWAY = ("PRJ-ABSENT", "PRJ-MASTER")


class KmsProjector(Projector):
    """Each `present` makes one flip and tells its time as the kernel measured it.

    The OpenGL context outlives a display that was switched off: after `open` what was loaded is
    still there, as long as the display takes the same size. Black at `open` and at `close`.
    `shortfalls` tells what is not as asked: PRJ-GAMMA, PRJ-CONSOLE, PRJ-SILENT.
    """

    def __init__(
        self,
        settings: KmsSettings | None = None,
        clock: Clock | None = None,
        open_card: Callable[[str], Card] = Card,
        make_screen: Callable[[int, tuple[int, int]], Screen] = Screen,
    ) -> None:
        """open_card, make_screen: where a test puts a card and buffers made of Python."""
        super().__init__()
        self.settings = settings or _default_settings()
        self._clock = clock or RealClock()
        self._choice = Choice(self.settings, self._clock, open_card)
        self._make_screen = make_screen
        self._card: Card | None = None
        self._screen: Screen | None = None
        self._output: Output | None = None
        self._watch: HotplugWatch | None = None
        self._timing: abi.ModeInfo | None = None
        self._mode: ProjectorMode | None = None
        self._frames: dict[int, int] = {}  # GBM's buffer to the kernel's framebuffer
        self._shown: Front | None = None
        self._grid: FlipGrid | None = None
        self._shortfalls: dict[str, DeviceError] = {}

    # Open and close

    def open(self) -> None:
        """Raises `DeviceAbsent` PRJ-CARD, PRJ-RIGHTS, PRJ-MASTER, PRJ-ATOMIC, PRJ-PLUG, PRJ-ROUTE,
        PRJ-ABSENT (no display answers), PRJ-SIZE (it has no such mode), PRJ-MODE, GPU-*."""
        if self._state is DeviceState.READY:
            return
        self._state = DeviceState.OPENING
        try:
            self._open_card()
            self._start()
        except OSError as error:
            self._fail("")
            raise _absent(commit_error(error)) from error
        except (DeviceError, ConfigError) as error:
            self._fail(error.code)
            if isinstance(error, DeviceLost | ConfigError):
                raise _absent(error) from error
            raise
        self._state = DeviceState.READY

    def _fail(self, code: str) -> None:
        """A display that is still away keeps its context; after all else everything is let go."""
        if code not in _AWAY or self._screen is None:
            self._release()
        self._state = DeviceState.ABSENT

    def _open_card(self) -> None:
        if self._card is not None:
            self._card.take_master()
            return
        self._card = self._choice.card()

    def _start(self) -> None:
        """The mode, the buffers and a first black picture."""
        card = self._card
        assert card is not None
        connector = self._choice.connector(card)
        if connector.connected is False and self.settings.force:
            if force_connector(card.path, connector.name):
                connector = card.connector(connector.number)
            self._short(
                "PRJ-SILENT",
                f"no display answers on {connector.name}; the signal is given all the same",
                "Switch the projector on.",
            )
        elif connector.connected is False:
            raise DeviceAbsent(
                "PRJ-ABSENT",
                f"no display answers on {connector.name}",
                "Switch the projector on and check the cable, or set force = true and a mode. "
                "It is retried every second.",
            )
        timing = self._choice.timing(connector)
        size = (timing.hdisplay, timing.vdisplay)
        if self._screen is not None and self._screen.size != size:
            self._release_screen()
        if self._screen is None:
            self._screen = self._make_screen(card.descriptor, size)
        if self._output is not None:
            self._output.release()
            self._output = None
        self._output = Output(card, connector)
        self._timing = timing
        rate = rate_hz(timing)
        self._mode = ProjectorMode(*size, rate, self.settings.lag_ms * 1e-3 + 0.5 / rate)
        self._silence()
        self._light_up()
        self._apply_curve()
        if self._watch is not None:
            self._watch.close()
        self._watch = card.watch(connector)
        self._choice.keep(card, connector, timing)

    def _light_up(self) -> None:
        """Switch the signal off and on again: a display that was away may need to see it begin."""
        assert self._screen is not None and self._output is not None and self._timing is not None
        with self._screen.context:
            self._screen.framebuffer.clear()
        front, frame = self._finish()
        try:
            with contextlib.suppress(DeviceLost):
                self._output.switch_off()
            self._output.switch_on(self._timing, frame)
        except BaseException:
            self._screen.give_back(front)
            raise
        self._keep(front)
        vblank = self._card.latest_vblank(self._output.crtc) if self._card else None
        vblank_s = None if vblank is None else vblank.time_s
        self._grid = FlipGrid(self._clock, rate_hz(self._timing), vblank_s)

    def _silence(self) -> None:
        if self.settings.silence_console and not silence_console():
            self._short(
                "PRJ-CONSOLE",
                "the text console cannot be kept off the projector",
                "Boot with fbcon=map:9 vt.global_cursor_default=0, or give the service "
                "CAP_SYS_TTY_CONFIG and the groups tty and video.",
            )

    def _apply_curve(self) -> None:
        if self.settings.brightness != 1.0 or self.settings.gamma != 1.0:
            self.set_curve(self.settings.brightness, self.settings.gamma)

    def _short(self, code: str, what: str, remedy: str) -> None:
        if code not in self._shortfalls:
            self._shortfalls[code] = DeviceError(code, what, remedy)
            _log.warning("%s", self._shortfalls[code])

    def close(self) -> None:
        """Black first."""
        if self._state is DeviceState.READY:
            with contextlib.suppress(DeviceError, OSError, moderngl.Error):
                with self.context:
                    self.framebuffer.clear()
                self.present()
                if self.settings.silence_console:
                    silence_console()
        self._release()
        self._state = DeviceState.ABSENT

    def _release(self) -> None:
        self._release_screen()
        if self._watch is not None:
            self._watch.close()
        if self._card is not None:
            self._card.close()
        self._card = self._output = self._watch = self._mode = self._timing = None

    def _release_screen(self) -> None:
        if self._card is not None:
            for frame in self._frames.values():
                with contextlib.suppress(OSError):
                    self._card.remove_framebuffer(frame)
        self._frames.clear()
        self._shown = None
        if self._screen is not None:
            self._screen.release()
        self._screen = None

    # What the stage uses

    def _ready(self) -> Screen:
        if self._state is DeviceState.LOST:
            raise DeviceLost("PRJ-LOST", "the display vanished", RETRIED)
        if self._screen is None or self._state is DeviceState.ABSENT:
            raise DeviceError("PRJ-CLOSED", "the projector is not open", "Open it before drawing.")
        return self._screen

    @property
    def mode(self) -> ProjectorMode:
        self._ready()
        assert self._mode is not None
        return self._mode

    @property
    def context(self) -> moderngl.Context:
        if self._screen is None:
            self._ready()
        assert self._screen is not None
        return self._screen.context

    @property
    def framebuffer(self) -> moderngl.Framebuffer:
        return self._ready().framebuffer

    @property
    def missed_flips(self) -> int:
        """Flips since `open` that came without a new picture."""
        return 0 if self._grid is None else self._grid.missed

    @property
    def shortfalls(self) -> tuple[DeviceError, ...]:
        """What is not as asked."""
        return tuple(self._shortfalls.values())

    @property
    def connector(self) -> str | None:
        """Name of the connector in use, as in /sys/class/drm."""
        return None if self._output is None else self._output.connector.name

    def next_flip_s(self) -> float:
        self._ready()
        assert self._grid is not None
        return self._grid.next_s()

    def present(self) -> float:
        """Raises `DeviceLost` PRJ-LOST, PRJ-MASTER, PRJ-COMMIT, PRJ-HUNG."""
        self._ready()
        try:
            self._follow_display()
            return self._present()
        except OSError as error:
            self._state = DeviceState.LOST
            raise commit_error(error) from error
        except DeviceError:
            self._state = DeviceState.LOST
            raise

    def _present(self) -> float:
        front, frame = self._finish()
        try:
            flip = self._make_flip(frame)
        except BaseException:
            if self._screen is not None:
                self._screen.give_back(front)
            raise
        self._keep(front)
        return flip.time_s

    def _make_flip(self, frame: int) -> Flip:
        assert self._card is not None and self._grid is not None
        due_s = self._grid.next_s()
        if not self._grid.paced:
            self._clock.sleep_until(due_s)
        self._commit_flip(frame)
        flip = self._card.wait_flip(_FLIP_TIMEOUT_S)
        if flip is None:
            raise DeviceLost(
                "PRJ-HUNG", f"the display driver made no flip for {_FLIP_TIMEOUT_S:g} s", RETRIED
            )
        self._grid.flipped(flip.time_s, due_s)
        return flip

    def _commit_flip(self, frame: int) -> None:
        assert self._output is not None and self._card is not None
        try:
            self._output.flip(frame)
        except OSError as error:
            if error.errno != errno.EBUSY:
                raise
            self._card.wait_flip(_FLIP_TIMEOUT_S)  # one that nobody waited for
            self._output.flip(frame)

    def _finish(self) -> tuple[Front, int]:
        """The drawn picture's buffer, and its framebuffer in the kernel."""
        screen, card = self._screen, self._card
        assert screen is not None and card is not None
        front = screen.swap()
        frame = self._frames.get(front.buffer)
        if frame is None:
            try:
                frame = card.add_framebuffer(screen.size, front.handle, front.stride)
            except BaseException:
                screen.give_back(front)
                raise
            self._frames[front.buffer] = frame
        return front, frame

    def _keep(self, front: Front) -> None:
        """`front` is on the screen now; the buffer before it may be drawn in again."""
        assert self._screen is not None
        if self._shown is not None:
            self._screen.give_back(self._shown)
        self._shown = front

    def _follow_display(self) -> None:
        """See to a display that went or came back. Raises `DeviceLost` PRJ-LOST."""
        assert self._watch is not None and self._output is not None and self._card is not None
        if not self._watch.changed(self._clock.now()):
            return
        there = self._card.connector(self._output.connector.number)
        if there.connected is False:
            if not self.settings.force:
                raise DeviceLost("PRJ-LOST", "the display was switched off or unplugged", RETRIED)
            return
        self._timing = self._choice.again(there.modes)
        _log.info("PRJ-BACK: a display answers on %s; the signal begins anew", there.name)
        self._relight()

    def _relight(self) -> None:
        """Begin the signal anew with the picture that is shown, keeping the one being drawn."""
        assert self._output is not None and self._timing is not None and self._shown is not None
        assert self._grid is not None
        frame = self._frames[self._shown.buffer]
        self._output.switch_off()
        self._output.switch_on(self._timing, frame)
        self._apply_curve()
        self._grid.begin_anew()

    def set_curve(self, brightness: float, gamma: float = 1.0) -> bool:
        """Brightness (0 to 1) and gamma by the card's table; False where it has none."""
        self._ready()
        assert self._output is not None
        done = self._output.set_curve(brightness, gamma)
        if not done:
            self._short(
                "PRJ-GAMMA",
                "the display card has no brightness table",
                "Set the brightness in the show or at the lamp.",
            )
        return done

    # Handing the display over to a newer version of the program

    def drop_master(self) -> None:
        """Let another program take the display; the picture stays until it does."""
        if self._card is not None:
            self._card.drop_master()

    def take_master(self) -> None:
        """Raises `DeviceAbsent` PRJ-MASTER."""
        if self._card is not None:
            self._card.take_master()


def _absent(error: DeviceError | ConfigError) -> DeviceAbsent:
    return DeviceAbsent(error.code, error.what, error.remedy)


def _default_settings() -> KmsSettings:
    """Loaded where it is needed: a stage that starts brings its settings and has no time."""
    from hypermask_drivers.projector.kms_settings import KmsSettings

    return KmsSettings()
