"""What a speaker is asked to say, so that the mouth learns the voice."""

from __future__ import annotations

ASKED = ("a", "i", "u", "e", "o", "silence")
"""The takes, in the order in which they are asked for."""
TAKE_S = 1.5
"""So long is listened for each; six make nine seconds."""
PROMPTS = {
    "a": 'Say a long "ah", as in father.',
    "i": 'Say a long "ee", as in see.',
    "u": 'Say a long "oo", as in who.',
    "e": 'Say a long "eh", as in bed.',
    "o": 'Say a long "oh", as in go.',
    "silence": "Stay silent for a moment.",
}
