"""A character's face on the mask: its vertices for an expression, a mouth and the lids."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.face import interior
from hypermask.face.character import Character
from hypermask.face.emotions import emotion_fields, emotion_mouths, emotion_weights
from hypermask.face.lids import Lids, close_lids, make_lids
from hypermask.face.mesh import Mesh, load_mesh
from hypermask.face.mouth import (
    Lips,
    check_mouth,
    combine,
    half_width,
    make_lips,
    mouth_fields,
    part_lips,
)
from hypermask.mask import Mask
from hypermask.stage.layers import Actor, MeshLayer

Array = NDArray[np.float64]
Positions = NDArray[np.float32]


@dataclass(frozen=True)
class Rig:
    """All that moves the mesh, the same for every character.

    fields: (19, 3 V) metres, six emotions then 13 mouth parameters; emotion_mouths: (6, 13).
    """

    mesh: Mesh
    fields: Array
    emotion_mouths: Array
    lids: Lids
    lips: Lips
    half_width: float


@functools.cache
def load_rig() -> Rig:
    mesh = load_mesh()
    fields = np.concatenate([emotion_fields(mesh), mouth_fields(mesh)])
    return Rig(
        mesh,
        fields.reshape(len(fields), -1),
        emotion_mouths(),
        make_lids(mesh),
        make_lips(mesh),
        half_width(mesh),
    )


def deform(
    rig: Rig,
    expression: Mapping[str, float] | ArrayLike | None = None,
    mouth: ArrayLike | None = None,
    lids: float | ArrayLike = 0.0,
) -> tuple[Array, Array]:
    """(flat (V, 2), out (V,)): places on the mask and how far forward, in metres.

    expression: weights of `EMOTIONS` by name or (6,); mouth: the 13 parameters; lids: 0 open to
    1 shut, one number or (left, right). An emotion's own mouth adds to the given one.
    Raises `UsageError` FACE-EMOTION, FACE-MOUTH.
    """
    weights = emotion_weights(expression)
    shape = np.zeros(13) if mouth is None else check_mouth(mouth)
    shape = combine(shape, weights @ rig.emotion_mouths)
    moves = (np.concatenate([weights, shape]) @ rig.fields).reshape(-1, 3)
    flat = rig.mesh.rest + moves[:, :2]
    part_lips(rig.lips, flat)
    left, right = np.broadcast_to(np.clip(np.asarray(lids, float), 0, 1), (2,))
    close_lids(rig.lids, flat, np.repeat([left, right], len(rig.lids.upper) // 2))
    return flat, moves[:, 2]


class Face:
    """A character laid on to a mask.

    `actor` holds the layers (eyes, mouth, lower teeth, upper teeth, skin) for the stage;
    `positions` gives their vertices for one frame.
    """

    def __init__(self, character: Character, mask: Mask) -> None:
        self.character = character
        self.mask = mask
        self.rig = load_rig()
        mesh = self.rig.mesh
        eyes, self._eye_places = interior.eye_layer(character.eyes)
        skin = MeshLayer("skin", mesh.triangles, mesh.uv, interior.rgba(character.texture))
        self.actor = Actor((eyes, interior.bag_layer(), *interior.teeth_layers(), skin))
        self._eyes = self._on_mask(self._eye_places, interior.EYE_DEPTH_M)

    def positions(
        self,
        expression: Mapping[str, float] | ArrayLike | None = None,
        mouth: ArrayLike | None = None,
        lids: float | ArrayLike = 0.0,
    ) -> tuple[Positions, ...]:
        """(V, 3) float32 metres in the mask frame for each layer of `actor`; see `deform`.

        What is projected lands on the mask's relief whatever the face's own depth, so the skin's
        vertices stay on it; the parts behind the openings lie a few millimetres deeper.
        """
        rig = self.rig
        flat, _ = deform(rig, expression, mouth, lids)
        lower, upper = interior.teeth_places(flat, rig.half_width)
        return (
            self._eyes,
            self._on_mask(interior.bag_places(flat), interior.BAG_DEPTH_M),
            self._on_mask(lower[:, :2], interior.TEETH_DEPTH_M + lower[:, 2]),
            self._on_mask(upper[:, :2], interior.TEETH_DEPTH_M + upper[:, 2]),
            self._on_mask(flat, 0.0),
        )

    def _on_mask(self, flat: Array, depth: float | Array) -> Positions:
        z = self.mask.height(flat[:, 0], flat[:, 1]) - depth
        return np.column_stack([flat, z]).astype(np.float32)
