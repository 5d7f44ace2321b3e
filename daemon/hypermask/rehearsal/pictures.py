"""The pictures of a rehearsal: the film that the audience sees, and the contact sheet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.rehearsal.cart import SimulatedCart
from hypermask.rehearsal.lockstep import Flip
from hypermask.tracking.tracker import TrackResult
from hypermask_drivers.camera import Frame
from hypermask_sim.audience import Audience
from hypermask_sim.film import FilmWriter

Image = NDArray[np.uint8]

FILM_RATE_HZ = 30.0
FILM_SIZE = (960, 720)
SHEET_MOMENTS = 12


@dataclass(frozen=True)
class Moment:
    """One cell of the contact sheet."""

    time_s: float
    caption: str
    audience: Image
    projector: Image
    camera: Image | None


class Pictures:
    """Takes flips while they are played; keeps a film and the moments for the contact sheet."""

    def __init__(self, cart: SimulatedCart, film: Path, duration_s: float) -> None:
        self._cart = cart
        self._audience = Audience(cart.projector.context, cart.world, FILM_SIZE)
        voice = cart.world.voice
        rate = cart.scenario.microphone.rate_hz
        start = round(cart.scenario.performer.voice_start_s * rate)
        sound = voice.block(-start, round(duration_s * rate))
        self._film = FilmWriter(film, FILM_SIZE, FILM_RATE_HZ, (sound, rate))
        self._frames = 0
        self._wanted = list(np.linspace(0.04, 0.98, SHEET_MOMENTS) * duration_s)
        self.moments: list[Moment] = []

    def take(self, flip: Flip, seen: tuple[Frame, TrackResult] | None, caption: str) -> None:
        """Add a flip; film frames are taken at the film's own rate, by the time of the light."""
        now = flip.picture.light_s - self._cart.world.origin_s
        due = self._frames / FILM_RATE_HZ <= now + 1e-9
        moment = bool(self._wanted) and now >= self._wanted[0]
        if not due and not moment:
            return
        view = self._audience.render(flip.shown, flip.picture.light_s)
        while self._frames / FILM_RATE_HZ <= now + 1e-9:
            self._film.add(view)
            self._frames += 1
        if moment:
            self._wanted.pop(0)
            camera = None if seen is None else mark_leds(*seen)
            self.moments.append(Moment(now, caption, view, flip.shown.copy(), camera))

    def close(self) -> None:
        """Finish the film; it appears under its name only when it is whole."""
        self._film.close()
        self._audience.close()

    def abandon(self) -> None:
        self._film.abort()
        self._audience.close()


def mark_leds(frame: Frame, result: TrackResult) -> Image:
    """The camera's frame (h, w, 3) with a ring round every LED that the tracker has labelled."""
    picture = cv2.cvtColor(frame.image, cv2.COLOR_GRAY2RGB)
    for index, point in enumerate(result.points):
        if np.isfinite(point).all():
            centre = (round(float(point[0])), round(float(point[1])))
            colour = (255, 200, 60) if index == 4 else (80, 220, 120)
            cv2.circle(picture, centre, 16, colour, 2, cv2.LINE_AA)
    return np.asarray(picture, np.uint8)
