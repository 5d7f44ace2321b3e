"""A photograph becomes a character (PAPERS B): landmarks, fit, normalised texture, blend."""

from __future__ import annotations

import datetime
import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.errors import DataError
from hypermask.face import points
from hypermask.face.character import (
    Character,
    check_name,
    encode_picture,
    load_character,
    save_character,
)
from hypermask.texture import regions
from hypermask.texture.advice import advice
from hypermask.texture.estimate import blend, estimate, hidden_share, small
from hypermask.texture.eyes import eye_textures
from hypermask.texture.fill import balance, belief
from hypermask.texture.landmarks import FaceFinder, Landmarks
from hypermask.texture.morphable import MorphableModel, load_model
from hypermask.texture.normalise import SIZE, Fit, normalise
from hypermask.texture.photo import decode_photo, read_photo
from hypermask.texture.pose import head_pose
from hypermask.texture.register import FROM_DEG, moved, shift
from hypermask.texture.source import face_of, kept_photo, record, rounded
from hypermask.texture.viewing import viewing

Image = NDArray[np.uint8]
Map = NDArray[np.float32]
Array = NDArray[np.float64]

MEAN = "mean"
"""The built-in character that stands in where a photograph shows no skin."""
_LEAST_BELIEF = 0.35
_MOST_HIDDEN = 0.5
_LIP_LINE = 0.55
_COMPRESSION = 1
"""Of the PNG: a few kB more than the usual 3, in two thirds of the time."""


@functools.cache
def _finder(folder: Path) -> FaceFinder:
    return FaceFinder(folder)


def warm_up() -> None:
    """Load what `build_character` needs, so that the first photograph takes no longer than others.

    Raises `DataError` FACE-MODELS, TEXTURE-MODEL.
    """
    face = mean_texture()
    make_texture(face, _finder(paths.models()).find(face))


def build_character(
    photo: Path,
    name: str,
    out: Path | None = None,
    date: datetime.date | None = None,
    size: int = SIZE,
    tell: Callable[[str], None] | None = None,
    source: str | None = None,
) -> Character:
    """Make and save the character `name` in the folder `out`/`name` (default: the user's own).

    size: texels of the texture's side, 512 or 1024; tell: is given each sentence of advice on a
    photograph that could be better; source: what the photograph is called, if not by its file.

    Raises `UsageError` CHAR-NAME; `DataError` PHOTO-ABSENT, PHOTO-FORMAT, PHOTO-SIZE, FACE-NONE,
    FACE-MANY, FACE-SMALL, FACE-HIDDEN, FACE-MODELS, TEXTURE-MODEL; `HypermaskError` DISK-WRITE.
    """
    check_name(name)
    image, data, side = read_photo(photo)
    kept, original = kept_photo(data, image, side)
    if not original:
        image = decode_photo(kept, photo)  # what is kept is what the texture is made from
    face = rounded(_finder(paths.models()).find(image))
    whole, seen, hidden, flat = _made(image, face, size, load_model())
    made = (date or datetime.date.today()).isoformat()
    # Two processors share what is left: OpenCV lets go of the interpreter while it works.
    with ThreadPoolExecutor(2) as pool:
        looking = pool.submit(_eyes, seen)
        texture = _finished(whole)
        packing = pool.submit(encode_picture, texture, _COMPRESSION)
        said = advice(image, face, hidden, flat)
        how = record(face, size, said, original)
    called, eyes = source or photo.name, looking.result()
    character = Character(name, called, made, texture, eyes, face.points, kept, how)
    if tell is not None:
        for sentence in said:
            tell(sentence)
    folder = (out or paths.home() / "characters") / name
    save_character(character, folder, _COMPRESSION, {"texture.png": packing.result()})
    return character


def rebuild(character: Character, size: int | None = None) -> Character:
    """The same character from what its own folder holds; nothing is written.

    size: of the texture, where it shall be another. Raises `DataError` CHAR-SOURCE, PHOTO-FORMAT.
    """
    face, usual = face_of(character)
    image = decode_photo(character.photo or b"", Path(character.name) / "photo.jpg")
    texture, eyes = make_texture(image, face, size or usual)
    how = {**(character.record or {}), "texture_size": size or usual}
    return replace(character, texture=texture, eyes=eyes, record=how)


def make_texture(
    image: Image,
    face: Landmarks,
    size: int = SIZE,
    model: MorphableModel | None = None,
    vertices: Array | None = None,
    beside: Map | None = None,
) -> tuple[Image, Image]:
    """(texture (size, size, 3), eyes), both RGB, from a photograph (h, w, 3) BGR and landmarks.

    size: 512 or 1024; model: another morphable model than the shipped one; vertices:
    (V, 2) pixels where the mesh lies in the photograph, instead of the automatic fit, and with
    it beside: the automatic fit's own `registration`, which a mesh placed by hand must not undo.
    Raises `DataError` FACE-HIDDEN, TEXTURE-MODEL.
    """
    whole, seen, *_ = _made(image, face, size, model or load_model(), vertices, beside)
    with ThreadPoolExecutor(1) as pool:
        eyes = pool.submit(_eyes, seen)
        return _finished(whole), eyes.result()


def registration(image: Image, face: Landmarks, model: MorphableModel | None = None) -> Map | None:
    """How far beside its texels a turned face's skin lies by the automatic fit (`register.shift`);
    None for a frontal one."""
    flat = _normalised(image, face, SIZE)
    off_front = head_pose(face.points).off_front_deg
    weight = np.minimum(belief(flat), viewing(face.points, off_front > FROM_DEG))
    return shift(model or load_model(), _lip_line(flat), weight, off_front)


def _made(
    image: Image,
    face: Landmarks,
    size: int,
    model: MorphableModel,
    vertices: Array | None = None,
    beside: Map | None = None,
) -> tuple[Image, Image, float, Image]:
    """(texture (size, size, 3) before it is balanced, the same at SIZE, share of the face before
    which something else is seen, photograph in the layout (SIZE, SIZE, 3)); all BGR.
    """
    flat = _normalised(image, face, SIZE, vertices)
    off_front = head_pose(face.points).off_front_deg
    weight = np.minimum(belief(flat), viewing(face.points, off_front > FROM_DEG))
    if float(weight.max()) < _LEAST_BELIEF:
        raise DataError(
            "FACE-HIDDEN", "too little skin is seen in the photograph", "Use another photograph."
        )
    lined = _lip_line(flat)
    if vertices is None:
        beside = shift(model, lined, weight, off_front)
    if beside is not None:
        lined = _lip_line(_normalised(image, face, SIZE, vertices, beside))
    found = estimate(model, small(lined), small(weight))
    fine = lined if size == SIZE else _lip_line(_normalised(image, face, size, vertices, beside))
    hidden = hidden_share(small(weight), found.weight)
    if hidden > _MOST_HIDDEN:
        raise DataError(
            "FACE-HIDDEN",
            f"{hidden:.0%} of the face is hidden or looks like no face",
            "Use another photograph.",
        )
    weight = _enlarged(np.minimum(weight, _enlarged(found.weight, SIZE)), size)
    whole = blend(fine, weight, _enlarged(found.whole, size))
    seen = whole if size == SIZE else _reduced(whole)
    return whole, seen, hidden, flat


def _finished(whole: Image) -> Image:
    """RGB, white balance and exposure brought to the model's."""
    return _rgb(balance(whole, mean_texture()))


def _eyes(seen: Image) -> Image:
    return _rgb(eye_textures(seen))


def plain_texture(
    image: Image, face: Landmarks, fit: Fit = "landmarks", model: MorphableModel | None = None
) -> Image:
    """(SIZE, SIZE, 3) RGB as if every photograph were frontal: what turning is measured against."""
    lined = _lip_line(normalise(image, face.points[:, :2], face.eye_distance, SIZE, fit))
    weight = belief(lined)
    found = estimate(model or load_model(), small(lined), small(weight))
    weight = np.minimum(weight, _enlarged(found.weight, SIZE))
    return _rgb(balance(blend(lined, weight, _enlarged(found.whole, SIZE)), mean_texture()))


def _normalised(
    image: Image,
    face: Landmarks,
    size: int,
    vertices: Array | None = None,
    beside: Map | None = None,
) -> Image:
    move = None if beside is None else functools.partial(moved, shift=beside)
    landmarks = face.points[:, :2]
    return normalise(image, landmarks, face.eye_distance, size, vertices=vertices, move=move)


def _enlarged(values: Map, size: int) -> Map:
    if values.shape[0] == size:
        return values
    return np.asarray(cv2.resize(values, (size, size), interpolation=cv2.INTER_LINEAR), np.float32)


def _reduced(texture: Image) -> Image:
    return np.asarray(cv2.resize(texture, (SIZE, SIZE), interpolation=cv2.INTER_AREA), np.uint8)


def _lip_line(texture: Image) -> Image:
    """Dark where the lips meet: a photograph with an open mouth has teeth there."""
    size = texture.shape[0]
    lips, share, rows = _lips(size)
    part = texture[rows]
    colour = np.median(part[lips], axis=0) * _LIP_LINE
    lined = texture.copy()
    lined[rows] = part * (1 - share) + colour * share
    return lined


@functools.cache
def _lips(size: int) -> tuple[NDArray[np.bool_], Map, slice]:
    """(lips without the gap between them, share of the gap (h, w, 1), the rows of both)."""
    gap = regions.grow(regions.polygon(points.LIPS_INNER), 0.8)
    outer = regions.polygon(points.LIPS_OUTER)
    found = np.flatnonzero(np.maximum(gap, outer).any(axis=1))
    factor = size // SIZE
    rows = slice(int(found[0] - 8) * factor, int(found[-1] + 8) * factor)
    lips = _enlarged(np.where(gap == 0, outer, 0).astype(np.float32), size) > 0.5
    share = _enlarged(regions.soften(gap, 0.4), size)
    return lips[rows], share[rows][..., None], rows


@functools.cache
def mean_texture() -> Image:
    """(SIZE, SIZE, 3) BGR of the built-in mean face."""
    return _rgb(load_character(paths.configs() / "characters" / MEAN).texture)


def _rgb(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
