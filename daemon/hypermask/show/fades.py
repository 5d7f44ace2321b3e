"""What of a scene's fades has come about at a moment: light, and who is seen how far."""

from __future__ import annotations

from hypermask.blackboard import Record


def progress(fade: Record, time_s: float) -> float:
    """How far a fade has gone at `time_s`: 0 to 1, with a soft start and end (smoothstep)."""
    duration = float(fade["duration_s"])
    if duration <= 0:
        return 1.0
    return ease((time_s - float(fade["start_s"])) / duration)


def ease(x: float) -> float:
    """0 to 1, with a soft start and end."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)


def brightness_at(scene: Record, time_s: float) -> float:
    """Brightness 0 to 1 at `time_s`."""
    done = progress(scene["brightness_fade"], time_s)
    return float(scene["previous_brightness"] * (1 - done) + scene["brightness"] * done)


def characters_at(scene: Record, time_s: float) -> list[tuple[str, float]]:
    """(name, opacity) of every character to draw at `time_s`; opacities sum to 1."""
    done = progress(scene["character_fade"], time_s)
    opacities = scene["previous_opacity"] * (1 - done) + scene["opacity"] * done
    named = zip(scene["characters"].tolist(), opacities.tolist(), strict=True)
    return [(name.decode(), opacity) for name, opacity in named if name and opacity > 0]
