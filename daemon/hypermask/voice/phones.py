"""Files of phone times: `{"w": [words: {"w": [{"b": begin_s, "d": duration_s, "t": label}]}]}`.

As pocketsphinx writes them. A flat list of such phones, under "w", under "phones" or bare, is read
as well. Labels: ARPAbet or IPA.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from hypermask.errors import DataError
from hypermask.storage import write_atomically
from hypermask.voice.synthesis import Phone
from hypermask.voice.visemes import classes_of


def read_phones(path: Path) -> list[Phone]:
    """In the order of time. Raises `DataError` VOICE-PHONES."""
    try:
        content = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise _bad(path, "does not exist") from None
    except OSError as error:
        raise _bad(path, f"cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise _bad(path, "is cut short or not JSON") from error
    try:
        spans = sorted(
            (float(leaf["b"]), float(leaf["b"]) + float(leaf["d"]), str(leaf["t"]))
            for leaf in _leaves(content)
        )
    except (KeyError, TypeError, ValueError) as error:
        raise _bad(path, f"has a phone without begin, duration or label ({error})") from error
    if not spans or not all(math.isfinite(end) and 0 <= begin <= end for begin, end, _ in spans):
        raise _bad(path, "has no phones, or one with impossible times")
    classes = classes_of([label for _, _, label in spans])
    if not any(classes):
        raise _bad(path, "has labels that are neither ARPAbet nor IPA")
    return [Phone(*span, found) for span, found in zip(spans, classes, strict=True)]


def _leaves(node: Any) -> list[dict[str, Any]]:
    if isinstance(node, list):
        return [leaf for part in node for leaf in _leaves(part)]
    for key in ("w", "phones"):
        if isinstance(node, dict) and isinstance(node.get(key), list):
            return _leaves(node[key])
    return [node]


def write_phones(phones: list[Phone], path: Path) -> None:
    """Raises `HypermaskError` DISK-WRITE."""
    leaves = [
        {"b": round(p.begin_s, 4), "d": round(p.end_s - p.begin_s, 4), "t": p.label} for p in phones
    ]
    write_atomically(path, (json.dumps({"w": leaves}, ensure_ascii=False) + "\n").encode())


def _bad(path: Path, why: str) -> DataError:
    return DataError(
        "VOICE-PHONES",
        f"the phone times {path} {why}",
        'Give a file like {"w": [{"b": 0.0, "d": 0.1, "t": "SIL"}, ...]}, times in seconds.',
    )
