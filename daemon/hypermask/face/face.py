"""A character's face on the mask: its vertices for an expression, a mouth and the lids."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.errors import UsageError
from hypermask.face import interior
from hypermask.face.action_units import (
    NUMBERS,
    ActionUnits,
    Weights,
    load_action_units,
    unit_weights,
)
from hypermask.face.character import Character
from hypermask.face.emotions import Variant, emotion_units, emotion_weights
from hypermask.face.features import carrier
from hypermask.face.lids import Lids, close_lids, make_lids
from hypermask.face.life import LIFE, Life
from hypermask.face.limits import Guard, hold, make_guard, reaches
from hypermask.face.mesh import Mesh, load_mesh
from hypermask.face.mouth import (
    Lips,
    check_mouth,
    half_width,
    make_lips,
    mouth_fields,
    part_lips,
    spoken,
)
from hypermask.mask import Mask
from hypermask.stage.layers import Actor, MeshLayer

Array = NDArray[np.float64]
Positions = NDArray[np.float32]


@dataclass(frozen=True)
class Rig:
    """All that moves the mesh, the same for every character.

    moves: (88, 144) metres, what each half of an action unit does to the 48 feature points;
    carrier: (V, 48), how the vertices follow them; reach: (48,) metres; mouth: (13, 3 V) metres.
    """

    mesh: Mesh
    units: ActionUnits
    moves: Array
    carrier: Array
    reach: Array
    mouth: Array
    lids: Lids
    lips: Lips
    guard: Guard
    half_width: float


@functools.cache
def load_rig() -> Rig:
    mesh, units = load_mesh(), load_action_units()
    return Rig(
        mesh,
        units,
        units.moves.reshape(len(units.moves), -1),
        carrier(),
        reaches(units.moves),
        mouth_fields(mesh).reshape(13, -1),
        make_lids(mesh),
        make_lips(mesh),
        make_guard(mesh),
        half_width(mesh),
    )


def deform(
    rig: Rig,
    expression: Mapping[str, float] | ArrayLike | None = None,
    mouth: ArrayLike | None = None,
    lids: float | ArrayLike = 0.0,
    units: Weights | ArrayLike | None = None,
    variant: Variant = "full",
    gaze: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """(flat (V, 2), out (V,)): places on the mask and how far forward, in metres.

    expression: weights of `EMOTIONS` by name or (6,); mouth: the 13 parameters; lids: 0 open to
    1 shut, one number or (left, right) as the audience sees them; units: action units by name, or
    (44,) or (88,), see `action_units.unit_weights`; variant: which combinations the emotions are;
    gaze: (right, up) in radians, which the upper lids follow.
    All of them add up; units that open or press the lips give way to a mouth that speech opens.
    Raises `UsageError` FACE-EMOTION, FACE-MOUTH, FACE-AU.
    """
    weights = follow_gaze(all_units(expression, units, variant), gaze)
    return _deform(rig, weights, mouth, lids)


def _deform(
    rig: Rig, weights: Array, mouth: ArrayLike | None, lids: float | ArrayLike
) -> tuple[Array, Array]:
    shape = np.zeros(13) if mouth is None else check_mouth(mouth)
    moves = _moves(rig, weights, shape)
    flat = rig.mesh.rest + moves[:, :2]
    part_lips(rig.lips, flat)
    shut = 1 - (1 - np.clip(np.asarray(lids, float), 0, 1)) * (1 - _shut(rig, weights))
    close_lids(rig.lids, flat, np.repeat(shut, len(rig.lids.upper) // 2))
    rig.guard.untangle(flat)
    return flat, moves[:, 2]


def follow_gaze(weights: Array, gaze: ArrayLike | None) -> Array:
    """(88,) with the upper lids going up and down with the eyes. Raises `UsageError` FACE-GAZE."""
    if gaze is None:
        return weights
    up = float(check_gaze(gaze)[1])
    number, most = (5, 0.9) if up > 0 else (41, 1.4)
    moved = weights.copy()
    first = 2 * NUMBERS.index(number)
    moved[first : first + 2] = np.minimum(moved[first : first + 2] + most * abs(up), 1)
    return moved


def check_gaze(gaze: ArrayLike) -> Array:
    """(2,) radians within 0.6 each way. Raises `UsageError` FACE-GAZE."""
    values = np.asarray(gaze, float)
    if values.shape != (2,) or not np.isfinite(values).all():
        raise UsageError("FACE-GAZE", "a gaze is not two finite angles", "Give right and up.")
    return np.asarray(np.clip(values, -0.6, 0.6))


def all_units(
    expression: Mapping[str, float] | ArrayLike | None,
    units: Weights | ArrayLike | None,
    variant: Variant = "full",
) -> Array:
    """(88,) intensities of emotions and units together, held within 0 to 1."""
    weights = unit_weights(units)
    if expression is not None:
        weights = weights + emotion_weights(expression) @ emotion_units(variant)
    return np.asarray(np.minimum(weights, 1))


def _moves(rig: Rig, weights: Array, mouth: Array) -> Array:
    """(V, 3) metres: what units (88,) and mouth (13,) do, before lips and lids meet."""
    given = ((weights * (1 - spoken(mouth) * rig.units.yields)) @ rig.moves).reshape(-1, 3)
    carried = rig.carrier @ hold(given, rig.reach)
    return np.asarray(carried + (mouth @ rig.mouth).reshape(-1, 3))


def _shut(rig: Rig, weights: Array) -> Array:
    """(2,) shares of closing by the lids' own units, the audience's left eye first."""
    return np.asarray(np.minimum(weights @ rig.units.lids, 1))


class Face:
    """A character laid on to a mask.

    `actor` holds the layers (eyes, mouth, lower teeth, upper teeth, skin, tongue) for the stage;
    `positions` gives their vertices for one frame, `alive` those of a face that also lives.
    """

    def __init__(self, character: Character, mask: Mask, variant: Variant = "full") -> None:
        self.character = character
        self.mask = mask
        self.variant = variant
        self.rig = load_rig()
        mesh = self.rig.mesh
        eyes, self._straight = interior.eye_layer(character.eyes)
        self._eye_shares = interior.eye_shares(self._straight)
        skin = MeshLayer("skin", mesh.triangles, mesh.uv, interior.rgba(character.texture))
        behind = (eyes, interior.bag_layer(), *interior.teeth_layers())
        self.actor = Actor((*behind, skin, interior.tongue_layer()))

    def positions(
        self,
        expression: Mapping[str, float] | ArrayLike | None = None,
        mouth: ArrayLike | None = None,
        lids: float | ArrayLike = 0.0,
        units: Weights | ArrayLike | None = None,
        gaze: ArrayLike | None = None,
    ) -> tuple[Positions, ...]:
        """(V, 3) float32 metres in the mask frame for each layer of `actor`; see `deform`.

        What is projected lands on the mask's relief whatever the face's own depth, so the skin's
        vertices stay on it; the parts behind the openings lie a few millimetres deeper.
        """
        rig = self.rig
        weights = follow_gaze(all_units(expression, units, self.variant), gaze)
        flat, _ = _deform(rig, weights, mouth, lids)
        lower, upper = interior.teeth_places(flat, rig.half_width)
        tongue = interior.tongue_places(flat, rig.half_width, *_tongue(rig, weights))
        return self._on_mask(
            (self._eyes_looking(gaze), interior.EYE_DEPTH_M),
            (interior.bag_places(flat), interior.BAG_DEPTH_M),
            (lower[:, :2], interior.TEETH_DEPTH_M + lower[:, 2]),
            (upper[:, :2], interior.TEETH_DEPTH_M + upper[:, 2]),
            (flat, 0.0),
            (tongue, 0.0),
        )

    def alive(
        self,
        time_s: float,
        expression: Mapping[str, float] | ArrayLike | None = None,
        mouth: ArrayLike | None = None,
        units: Weights | ArrayLike | None = None,
        life: Life = LIFE,
    ) -> tuple[Positions, ...]:
        """`positions` with the blinks, the gaze and the breath of this moment."""
        breathing = np.minimum(unit_weights(units) + life.units(time_s), 1)
        gaze = life.gaze_at(time_s) if life.gaze else None
        return self.positions(expression, mouth, life.lids(time_s), breathing, gaze)

    def _eyes_looking(self, gaze: ArrayLike | None) -> Array:
        if gaze is None:
            return self._straight
        return interior.eye_places(self._straight, self._eye_shares, check_gaze(gaze))

    def _on_mask(self, *layers: tuple[Array, float | Array]) -> tuple[Positions, ...]:
        """Places (V, 2) and depths behind the relief of each layer -> (V, 3); one look-up for all,
        for it costs as much for a few points as for many.
        """
        flat = np.concatenate([places for places, _ in layers])
        found = np.column_stack([flat, self.mask.height(flat[:, 0], flat[:, 1])])
        ends = np.cumsum([len(places) for places, _ in layers])[:-1]
        whole = np.split(found, ends)
        for places, (_, depth) in zip(whole, layers, strict=True):
            places[:, 2] -= depth
        return tuple(places.astype(np.float32) for places in whole)


def _tongue(rig: Rig, weights: Array) -> tuple[float, float]:
    """(out, side): how far the tongue is shown, and to which side of the audience."""
    halves = weights.reshape(-1, 2)
    share = rig.units.tongue[::2]
    side = float((halves[:, 0] - halves[:, 1]) @ share)
    return min(float(halves.max(axis=1) @ share), 1.0), max(-1.0, min(side, 1.0))
