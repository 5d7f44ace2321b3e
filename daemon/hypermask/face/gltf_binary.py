"""Writes the binary container of glTF 2.0: accessors over one buffer, and the GLB around it."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FLOAT, _USHORT, _UINT = 5126, 5123, 5125
_ARRAY, _ELEMENTS = 34962, 34963
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}
_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942


class Buffer:
    """Collects the buffer's bytes with their views and accessors; everything starts at 4 bytes."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, data: bytes, target: int | None = None) -> int:
        """The index of a new buffer view."""
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += data
        return len(self.views) - 1

    def vectors(self, values: NDArray[Any], bounds: bool = False) -> int:
        """An accessor of vertex attributes (n, 2 or 3); bounds: with min and max, for positions."""
        rows = np.ascontiguousarray(values, np.float32)
        return self._accessor(rows, bounds, {"bufferView": self.view(rows.tobytes(), _ARRAY)})

    def numbers(self, values: NDArray[Any], bounds: bool = False) -> int:
        """An accessor of numbers (n,) for animations."""
        rows = np.ascontiguousarray(values, np.float32).reshape(-1, 1)
        return self._accessor(rows, bounds, {"bufferView": self.view(rows.tobytes())})

    def indices(self, triangles: NDArray[Any]) -> int:
        flat = triangles.reshape(-1)
        wide = int(flat.max()) > 65534
        data = np.ascontiguousarray(flat, np.uint32 if wide else np.uint16).tobytes()
        self.accessors.append(
            {
                "bufferView": self.view(data, _ELEMENTS),
                "componentType": _UINT if wide else _USHORT,
                "count": len(flat),
                "type": "SCALAR",
            }
        )
        return len(self.accessors) - 1

    def offsets(self, values: NDArray[Any], least: float, bounds: bool = False) -> int:
        """An accessor of displacements (n, 3), of which those below `least` are left out.

        Sparse where that is smaller; without any bytes where all are zero.
        """
        rows = np.where(np.abs(values) < least, 0, values).astype(np.float32)
        moved = np.flatnonzero(rows.any(axis=1))
        if not len(moved):
            return self._accessor(rows, bounds, {})
        if len(moved) * (2 + 12) >= len(rows) * 12 or len(rows) > 65535:
            return self.vectors(rows, bounds)
        sparse = {
            "count": len(moved),
            "indices": {
                "bufferView": self.view(moved.astype(np.uint16).tobytes()),
                "componentType": _USHORT,
            },
            "values": {"bufferView": self.view(np.ascontiguousarray(rows[moved]).tobytes())},
        }
        return self._accessor(rows, bounds, {"sparse": sparse})

    def _accessor(self, rows: NDArray[np.float32], bounds: bool, where: dict[str, Any]) -> int:
        accessor: dict[str, Any] = {
            **where,
            "componentType": _FLOAT,
            "count": len(rows),
            "type": _TYPES[rows.shape[1]],
        }
        if bounds:
            accessor["min"] = rows.min(axis=0).astype(float).tolist()
            accessor["max"] = rows.max(axis=0).astype(float).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def container(document: dict[str, Any], buffer: Buffer) -> bytes:
    """The GLB file of a document, to which the buffer's accessors and views are added."""
    binary = bytes(buffer.data) + b"\0" * (-len(buffer.data) % 4)
    whole = {
        **document,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    text = json.dumps(whole, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(binary)
    head = struct.pack("<III", _MAGIC, 2, length)
    chunks = struct.pack("<II", len(text), _JSON) + text
    return head + chunks + struct.pack("<II", len(binary), _BIN) + binary
