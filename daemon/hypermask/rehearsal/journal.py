"""What happened in a rehearsal, in the order of time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    time_s: float
    code: str
    text: str


class Journal:
    """Collects events; call it as a worker's `report`."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def __call__(self, time_s: float, code: str, text: str) -> None:
        self.events.append(Event(time_s, code, text))

    def as_data(self, origin_s: float = 0.0) -> list[dict[str, float | str]]:
        """Ordered by time, which counts from `origin_s`; what came before it is at 0."""
        ordered = sorted(self.events, key=lambda event: event.time_s)
        return [
            {
                "time_s": round(max(event.time_s - origin_s, 0.0), 6),
                "code": event.code,
                "text": event.text,
            }
            for event in ordered
        ]
