"""A whole calibration in a rehearsal: the session, fed by callables instead of devices."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from hypermask.calibration.outcome import Outcome
from hypermask.calibration.positions import Position
from hypermask.calibration.session import Phase, Session, View
from hypermask.calibration.still import Sighting
from hypermask.errors import DataError

Operate = Callable[[tuple[int, int], int], str]
"""(lit cross-hair, LED index it belongs on) -> the key that the operator presses next."""
MeasurePose = Callable[[Position], Iterable[Sighting]]
"""Puts the mask at a position and tracks it there: at least `session.LEAST_FRAMES` frames."""

MOST_KEYS = 20_000


@dataclass(frozen=True)
class Rehearsed:
    """outcome; key_presses of the whole session; positions that were set up, in order."""

    outcome: Outcome
    key_presses: int
    positions: tuple[Position, ...]


def rehearse(
    session: Session,
    measure_pose: MeasurePose,
    operate: Operate,
    watch: Callable[[View], None] | None = None,
    extra_positions: int = 0,
) -> Rehearsed:
    """Run `session` to its end; at its review add `extra_positions` suggested ones, then accept.

    watch: called with every view that is lit, for pictures of the session. The times are those of
    the sightings. Raises `DataError` CAL-* as `outcome.conclude`, CAL-UNSEEN where `measure_pose`
    gives too few frames, CAL-ENDLESS where the operator comes to no end.
    """
    visited: list[Position] = []
    for _ in range(MOST_KEYS):
        view = session.view()
        if watch is not None:
            watch(view)
        if session.phase is Phase.DONE:
            assert session.outcome is not None
            return Rehearsed(session.outcome, session.key_presses, tuple(visited))
        if session.phase is Phase.PLACE:
            assert view.target is not None
            visited.append(view.target)
            _place(session, list(measure_pose(view.target)))
        elif session.phase is Phase.CLICK:
            assert view.cross_hair is not None and view.led is not None
            session.key(operate(view.cross_hair, view.led), session.now_s)
        else:
            extra_positions = _review(session, extra_positions)
    raise DataError(
        "CAL-ENDLESS", f"no end after {MOST_KEYS} key presses", "Check the operator's aim."
    )


def _place(session: Session, sightings: list[Sighting]) -> None:
    """Starts the clicks once the mask is seen, and lets it be seen while it stands still."""
    if not sightings:
        raise _unseen(session)
    _feed(session, sightings[:1])
    session.key("enter", session.now_s)
    _feed(session, sightings[1:])
    if not session.ready:
        raise _unseen(session)
    session.settle()


def _feed(session: Session, sightings: list[Sighting]) -> None:
    for sighting in sightings:
        session.sighting(sighting, sighting.time_s)


def _review(session: Session, extra: int) -> int:
    if session.problem is not None:
        raise session.problem
    session.key("plus" if extra > 0 else "enter", session.now_s)
    return max(0, extra - 1)


def _unseen(session: Session) -> DataError:
    return DataError(
        "CAL-UNSEEN",
        f"the mask was seen in too few frames at position {len(session.ends) + 1}",
        "Check that the LEDs are on and in the camera's picture.",
    )
