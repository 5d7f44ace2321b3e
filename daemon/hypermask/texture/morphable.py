"""The texture morphable model: mean and principal components of faces in one layout (PAPERS B4).

morphable.json   version, sizes, scales, variances, the mesh's landmarks it was made for, SHA-256
morphable.webp   tiles of SIDE x SIDE: the mean, what the bases leave, then one basis after another

Both are made by `hypermask.texture.morphable_train`; attribution in NOTICE.
"""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.storage import write_atomically

Map = NDArray[np.float32]
Array = NDArray[np.float64]

VERSION = 1
SIDE = 256
"""Texels of the model: the whole of the texture's layout at half its usual resolution."""
FOLDER = Path(__file__).with_name("data")
_COLUMNS = 6
_QUALITY = 95
_SPREAD_SCALE = 5.0


@dataclass(frozen=True, eq=False)
class MorphableModel:
    """x = mean + sum_j a_j bases_j; colours are BGR, 0 to 255.

    mean: (SIDE, SIDE, 3); bases: (n, SIDE, SIDE, 3), orthonormal; variances: (n,) of a over the
    faces; spread: (SIDE, SIDE) rms of what is left of an unknown face; noise: its mean square;
    landmarks: (468, 2) mm, the places on the mask of the layout that it was made in.
    """

    mean: Map
    bases: Map
    variances: Array
    spread: Map
    noise: float
    landmarks: Array

    @property
    def count(self) -> int:
        return len(self.bases)

    def texture(self, coefficients: Array) -> Map:
        """(SIDE, SIDE, 3) of coefficients (n,), n at most `count`."""
        bases = self.bases[: len(coefficients)].reshape(len(coefficients), -1)
        offset = coefficients.astype(np.float32) @ bases
        return np.asarray(self.mean + offset.reshape(self.mean.shape), np.float32)


def principal_components(textures: Map, count: int) -> tuple[Map, Map, Array]:
    """(mean, bases (count, ...), variances (count,)) of textures (n, h, w, 3), n > count.

    By the Gram matrix, since there are far fewer faces than texels.
    """
    mean = textures.mean(axis=0)
    flat = (textures - mean).reshape(len(textures), -1)
    values, vectors = np.linalg.eigh((flat @ flat.T).astype(float))
    order = np.argsort(values)[::-1][:count]
    bases = (vectors[:, order] / np.sqrt(np.maximum(values[order], 1e-9))).T.astype(np.float32)
    shape = (count, *textures.shape[1:])
    return mean, (bases @ flat).reshape(shape), values[order] / (len(textures) - 1)


def save_model(model: MorphableModel, folder: Path = FOLDER) -> int:
    """Write both files; returns their bytes. Raises `HypermaskError` DISK-WRITE."""
    scales = np.abs(model.bases).max(axis=(1, 2, 3)) / 127
    tiles = [model.mean, np.repeat(model.spread[..., None] * _SPREAD_SCALE, 3, axis=2)]
    tiles += [128 + basis / scale for basis, scale in zip(model.bases, scales, strict=True)]
    image = np.clip(np.round(_mosaic(tiles)), 0, 255).astype(np.uint8)
    data = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])[1].tobytes()
    fields = {
        "version": VERSION,
        "side": SIDE,
        "count": model.count,
        "sha256": hashlib.sha256(data).hexdigest(),
        "noise": round(model.noise, 3),
        "scales": [float(f"{scale:.6g}") for scale in scales],
        "variances": [float(f"{variance:.6g}") for variance in model.variances],
        "landmarks_mm": np.round(model.landmarks, 2).tolist(),
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in fields.items()]
    text = ("{\n" + ",\n".join(lines) + "\n}\n").encode()
    write_atomically(folder / "morphable.webp", data)
    write_atomically(folder / "morphable.json", text)
    return len(data) + len(text)


def _mosaic(tiles: list[Map]) -> Map:
    empty = np.full((SIDE, SIDE, 3), 128, np.float32)
    full = tiles + [empty] * (-len(tiles) % _COLUMNS)
    rows = [np.concatenate(full[i : i + _COLUMNS], 1) for i in range(0, len(full), _COLUMNS)]
    return np.concatenate(rows)


@functools.cache
def load_model(folder: Path = FOLDER) -> MorphableModel:
    """Raises `DataError` TEXTURE-MODEL where a file is absent, damaged or of another version."""
    try:
        fields: dict[str, Any] = json.loads((folder / "morphable.json").read_text("utf-8"))
        data = (folder / "morphable.webp").read_bytes()
        if fields["version"] != VERSION or fields["side"] != SIDE:
            raise _unusable(folder, f"its version is {fields['version']}, known is {VERSION}")
        if hashlib.sha256(data).hexdigest() != fields["sha256"]:
            raise _unusable(folder, "morphable.webp is not the file that belongs to it")
        return _decoded(fields, data)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _unusable(folder, f"it cannot be read: {error}") from error


def _decoded(fields: dict[str, Any], data: bytes) -> MorphableModel:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("morphable.webp is not a picture")
    rows = image.shape[0] // SIDE
    tiles = image.reshape(rows, SIDE, _COLUMNS, SIDE, 3).swapaxes(1, 2).reshape(-1, SIDE, SIDE, 3)
    count = int(fields["count"])
    bases = tiles[2 : count + 2].astype(np.float32) - 128
    bases *= np.array(fields["scales"], np.float32)[:, None, None, None]
    return MorphableModel(
        tiles[0].astype(np.float32),
        bases,
        np.array(fields["variances"], float),
        np.asarray(tiles[1].mean(axis=2) / _SPREAD_SCALE, np.float32),
        float(fields["noise"]),
        np.array(fields["landmarks_mm"], float),
    )


def _unusable(folder: Path, why: str) -> DataError:
    return DataError(
        "TEXTURE-MODEL", f"the texture model in {folder} is unusable: {why}", "Install it again."
    )
