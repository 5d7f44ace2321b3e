"""Where the mesh lies in the photograph: the automatic fit and what was moved in each level.

places = A (base + sum over the finer levels of carrier x moved), A the affine map that takes the
three handles of the level "face" from where the automatic fit has them to where they were put. So
finer corrections ride on coarser ones, and each dragged handle lands exactly where it is put.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import Mesh
from hypermask.fitting.folds import free_share, upright_areas
from hypermask.fitting.handles import LEVELS, Level, load_levels
from hypermask.fitting.history import Change

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pull:
    """A drag that was begun: the level, the rows of its handles (the dragged one, then its mirror
    image where both move), the mesh, the handles and the values as they were.
    """

    level: Level
    rows: NDArray[np.intp]
    across: Array
    start: Array
    handles: Array
    values: Array


class Shape:
    """moved: level -> (H, 2) pixels, for "face" of the handles, else before its affine map."""

    def __init__(self, mesh: Mesh, base: Array) -> None:
        self.mesh = mesh
        self.base = base
        self.levels = load_levels()
        self.moved = {n: np.zeros((len(self.levels[n].handles), 2)) for n in LEVELS}
        paired = np.flatnonzero(mesh.rest[:, 0] > mesh.rest[mesh.mirror, 0])
        self._pairs = paired, mesh.mirror[paired]

    def places(self) -> Array:
        """(V, 2) pixels."""
        linear, offset = self._affine()
        return np.asarray(self._corrected() @ linear.T + offset)

    def handles(self, level: str) -> Array:
        """(H, 2) pixels."""
        return np.asarray(self.levels[level].means @ self.places())

    def pull(self, level: str, row: int, mirrored: bool) -> Pull:
        """Begin to drag one handle."""
        found, start = self.levels[level], self.places()
        both = mirrored and found.mirror[row] != row
        rows = np.array([row, found.mirror[row]] if both else [row], np.intp)
        values = self.moved[level].copy()
        return Pull(found, rows, self._across(), start, found.means @ start, values)

    def move(self, pull: Pull, target: Array) -> float:
        """Bring the dragged handle to target (2,), always from where the drag began.

        Gives the share of the way that it could go before a triangle would turn over, usually 1.
        """
        step = target - pull.handles[pull.rows[0]]
        steps = np.array([step, step - 2 * (step @ pull.across) * pull.across])[: len(pull.rows)]
        share = free_share(self.mesh, pull.start, self._way(pull, steps))
        self.moved[pull.level.name] = self._values(pull, steps * share)
        return share

    def change(self, pull: Pull) -> Change | None:
        """What the drag changed, None for nothing."""
        after = self.moved[pull.level.name]
        rows = np.flatnonzero((after != pull.values).any(axis=1))
        if not len(rows):
            return None
        return Change(pull.level.name, rows, pull.values[rows], after[rows])

    def set(self, level: str, rows: NDArray[np.intp], values: Array) -> None:
        changed = self.moved[level].copy()
        changed[rows] = values
        self.moved[level] = changed

    def clear(self, level: str) -> tuple[Change, ...]:
        """Put a level back to nothing moved; gives what that changed, if anything."""
        before = self.moved[level]
        rows = np.flatnonzero(before.any(axis=1))
        if not len(rows):
            return ()
        self.moved[level] = np.zeros_like(before)
        return (Change(level, rows, before[rows], np.zeros((len(rows), 2))),)

    def folded(self) -> bool:
        """Whether a triangle is turned over that the automatic fit has upright."""
        upright = upright_areas(self.mesh, self.base) > 0
        return bool((upright_areas(self.mesh, self.places())[upright] <= 0).any())

    def _way(self, pull: Pull, steps: Array) -> Array:
        """(V, 2) pixels: where all vertices go when the handles take these steps."""
        if pull.level.carrier is not None:
            return np.asarray(pull.level.carrier[:, pull.rows] @ steps)
        linear, offset = self._carried(pull, steps)
        return np.asarray(pull.start @ linear.T + offset - pull.start)

    def _values(self, pull: Pull, steps: Array) -> Array:
        """(H, 2) the level's values after the handles took these steps from the drag's begin."""
        values = pull.values.copy()
        if pull.level.carrier is not None:
            linear, _ = self._affine()
            values[pull.rows] += np.linalg.solve(linear, steps.T).T
            return values
        linear, offset = self._carried(pull, steps)
        sources = pull.level.means @ self.base
        return np.asarray((sources + values) @ linear.T + offset - sources)

    def _carried(self, pull: Pull, steps: Array) -> tuple[Array, Array]:
        """The affine map of the photograph that takes the three handles along."""
        targets = pull.handles.copy()
        targets[pull.rows] += steps
        return affine(pull.handles, targets)

    def _affine(self) -> tuple[Array, Array]:
        moved = self.moved["face"]
        if not moved.any():
            return np.eye(2), np.zeros(2)
        sources = self.levels["face"].means @ self.base
        return affine(sources, sources + moved)

    def _corrected(self) -> Array:
        places = self.base.copy()
        for name in LEVELS:
            carrier = self.levels[name].carrier
            if carrier is not None and self.moved[name].any():
                places += carrier @ self.moved[name]
        return places

    def _across(self) -> Array:
        """(2,) unit vector across the face's midline, whatever the head's roll."""
        linear, _ = self._affine()
        right, left = self._pairs
        across = linear @ (self.base[right] - self.base[left]).mean(axis=0)
        return np.asarray(across / np.linalg.norm(across))


def affine(sources: Array, targets: Array) -> tuple[Array, Array]:
    """(linear (2, 2), offset (2,)) that takes three points (3, 2) to three others."""
    known: NDArray[Any] = np.column_stack([sources, np.ones(3)])
    solved = np.linalg.solve(known, targets)
    return solved[:2].T, solved[2]
