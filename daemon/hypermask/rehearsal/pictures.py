"""The pictures of a rehearsal: the film that the audience sees, and the contact sheet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.rehearsal.cart import SimulatedCart
from hypermask.rehearsal.lockstep import Flip
from hypermask.tracking.tracker import TrackResult
from hypermask_drivers.camera import Frame
from hypermask_sim.audience_robot import audience_of
from hypermask_sim.film import FilmWriter
from hypermask_sim.sheet import Moment

Image = NDArray[np.uint8]

FILM_RATE_HZ = 30.0
FILM_SIZE = (960, 720)
SHEET_MOMENTS = 12


class Pictures:
    """Takes flips while they are played; keeps a film and the moments for the contact sheet."""

    def __init__(
        self, cart: SimulatedCart, film: Path, duration_s: float, rate_hz: float = FILM_RATE_HZ
    ) -> None:
        self._rate_hz = rate_hz
        self._cart = cart
        self._audience = audience_of(cart.projector.context, cart.world, FILM_SIZE)
        voice = cart.world.voice
        rate = cart.scenario.microphone.rate_hz
        # The audience hears the loudspeaker, which waits for the mouth.
        late_s = cart.scenario.loudspeaker.delay_ms * 1e-3
        start = round((cart.scenario.performer.voice_start_s + late_s) * rate)
        sound = voice.block(-start, round(duration_s * rate))
        self._film = FilmWriter(film, FILM_SIZE, rate_hz, (sound, rate))
        self._frames = 0
        self._wanted = list(np.linspace(0.04, 0.98, SHEET_MOMENTS) * duration_s)
        self.moments: list[Moment] = []

    def take(self, flip: Flip, seen: tuple[Frame, TrackResult] | None, caption: str) -> None:
        """Add a flip; film frames are taken at the film's own rate, by the time of the light."""
        now = flip.picture.light_s - self._cart.world.origin_s
        due = self._frames / self._rate_hz <= now + 1e-9
        moment = bool(self._wanted) and now >= self._wanted[0]
        if not due and not moment:
            return
        view = self._audience.render(flip.shown, flip.picture.light_s)
        while self._frames / self._rate_hz <= now + 1e-9:
            self._film.write(view)
            self._frames += 1
        if moment:
            self._wanted.pop(0)
            frame, leds = (None, None) if seen is None else (seen[0].image.copy(), seen[1].points)
            neck = self._cart.world.neck
            head = None
            if neck is not None:
                pan, tilt = np.degrees(neck(flip.picture.light_s))
                head = (float(pan), float(tilt))
            self.moments.append(Moment(now, caption, view, flip.shown.copy(), frame, leds, head))

    def close(self) -> None:
        """Finish the film; it appears under its name only when it is whole."""
        self._film.close()
        self._audience.close()

    def abandon(self) -> None:
        self._film.discard()
        self._audience.close()
