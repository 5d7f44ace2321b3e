"""A session of the fitting tool: one photograph, its mesh, the drags, undo, the live texture.

Everything it takes and gives is numbers, text and arrays; `fitting.protocol` speaks JSON.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import UsageError
from hypermask.face.character import Character
from hypermask.face.face import Face
from hypermask.face.mesh import load_mesh
from hypermask.fitting.checks import finite, known_handle, known_level, near_photo
from hypermask.fitting.handles import LEVELS
from hypermask.fitting.history import LIMIT_BYTES, Change, History, Step
from hypermask.fitting.live import LiveTexture
from hypermask.fitting.shape import Pull, Shape
from hypermask.mask import Mask
from hypermask.texture.normalise import SIZE, vertices_in_photo

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_REACHED = 1 - 1e-12


@dataclass(frozen=True)
class Dragged:
    """place: (2,) pixels where the handle is now; share: of the way it was asked to go, below 1
    where the mesh would have folded; mirror: the handle that moved along, or None.
    """

    handle: str
    place: tuple[float, float]
    share: float
    mirror: str | None

    @property
    def held(self) -> bool:
        return self.share < _REACHED


class Fitting:
    """Corrects where the mesh lies in a photograph.

    photo: (h, w, 3) BGR; landmarks: (468, 3) pixels, as found; character: what the texture is
    made for, if there is one already. With `mirror` on, a drag moves the handle on the face's other
    side as a mirror image about the face's own midline.
    """

    def __init__(
        self,
        photo: Image,
        landmarks: Array,
        character: Character | None = None,
        history_bytes: int = LIMIT_BYTES,
    ) -> None:
        self.photo = photo
        self.mirror = False
        self._landmarks = landmarks
        self._shape = Shape(load_mesh(), vertices_in_photo(landmarks[:, :2]))
        self._history = History(history_bytes)
        self._pull: Pull | None = None
        self._live = LiveTexture(photo, landmarks)
        self._character = character

    # -- what there is -----------------------------------------------------------------------

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the photograph."""
        return self.photo.shape[1], self.photo.shape[0]

    @property
    def steps(self) -> tuple[int, int]:
        """How many steps can be undone, and redone."""
        return self._history.counts

    @property
    def moved(self) -> dict[str, Array]:
        """Level -> (H, 2) pixels, what was moved; copies."""
        return {name: values.copy() for name, values in self._shape.moved.items()}

    @property
    def dragging(self) -> str | None:
        pull = self._pull
        return None if pull is None else pull.level.handles[int(pull.rows[0])]

    def vertices(self) -> Array:
        """(V, 2) pixels: the whole mesh in the photograph."""
        return self._shape.places()

    def handles(self, level: str) -> dict[str, tuple[float, float]]:
        """Name -> place in pixels. Raises `UsageError` FIT-LEVEL."""
        found = known_level(level, self._shape.levels)
        places = self._shape.handles(level).tolist()
        return {name: (x, y) for name, (x, y) in zip(found.handles, places, strict=True)}

    def mirrored(self, handle: str) -> str:
        """The handle on the face's other side; in the middle itself. Raises FIT-HANDLE."""
        level, row = known_handle(handle, self._shape.levels)
        return level.handles[int(level.mirror[row])]

    def nearest(self, level: str, x: float, y: float, radius: float) -> str | None:
        """The level's handle nearest to a pixel within a radius. Raises FIT-LEVEL, FIT-PLACE."""
        found, place = known_level(level, self._shape.levels), np.array([finite(x), finite(y)])
        gaps = np.linalg.norm(self._shape.handles(level) - place, axis=1)
        best = int(gaps.argmin())
        return found.handles[best] if gaps[best] <= finite(radius) else None

    # -- drags -------------------------------------------------------------------------------

    def begin(self, handle: str) -> None:
        """Take hold of a handle. Raises `UsageError` FIT-HANDLE, FIT-DRAG."""
        self._rest("begin another")
        level, row = known_handle(handle, self._shape.levels)
        self._pull = self._shape.pull(level.name, row, self.mirror)

    def move(self, x: float, y: float) -> Dragged:
        """Bring the held handle to a pixel, or as near as the mesh goes without folding.

        Raises `UsageError` FIT-DRAG, FIT-PLACE.
        """
        pull = self._held()
        share = self._shape.move(pull, near_photo(x, y, self.size))
        names, row = pull.level.handles, int(pull.rows[0])
        at = pull.level.means[pull.rows[0]] @ self._shape.places()
        other = names[int(pull.rows[1])] if len(pull.rows) > 1 else None
        return Dragged(names[row], (float(at[0]), float(at[1])), share, other)

    def end(self) -> bool:
        """Let go; one step for undo. Gives whether anything moved. Raises `UsageError` FIT-DRAG."""
        change = self._shape.change(self._held())
        self._pull = None
        if change is not None:
            self._history.push((change,))
        return change is not None

    def cancel(self) -> None:
        """Let go and put everything back. Raises `UsageError` FIT-DRAG."""
        pull = self._held()
        self._shape.set(pull.level.name, np.arange(len(pull.values)), pull.values)
        self._pull = None

    def drag(self, handle: str, x: float, y: float) -> Dragged:
        """A whole drag at once: `begin`, `move`, `end`. Raises FIT-HANDLE, FIT-DRAG, FIT-PLACE."""
        place = near_photo(x, y, self.size)
        self.begin(handle)
        done = self.move(*place.tolist())
        self.end()
        return done

    def undo(self) -> bool:
        """Take the last step back; False where there is none. Raises `UsageError` FIT-DRAG."""
        self._rest("undo")
        return self._put(self._history.undo(), before=True)

    def redo(self) -> bool:
        """Do the step again that was taken back last. Raises `UsageError` FIT-DRAG."""
        self._rest("redo")
        return self._put(self._history.redo(), before=False)

    def reset(self, level: str | None = None) -> bool:
        """Put a level, or all, back to the automatic fit; a step that can be undone.

        Where the other levels' corrections would fold the mesh without this one's, they go as well,
        the finest first. Raises `UsageError` FIT-LEVEL, FIT-DRAG.
        """
        self._rest("reset")
        first = LEVELS if level is None else (known_level(level, self._shape.levels).name,)
        step: list[Change] = []
        for name in (*first, *(other for other in LEVELS[::-1] if other not in first)):
            if name in first or self._shape.folded():
                step += self._shape.clear(name)
        if step:
            self._history.push(tuple(step))
        return bool(step)

    def restore(self, moved: Mapping[str, Array]) -> float:
        """Take over what was moved, as `moved` gives it, and forget the steps.

        Gives the share that could be taken over without folding the mesh, usually 1.
        """
        self._history, self._pull = History(), None
        for share in np.linspace(1, 0, 11):
            for name in LEVELS:
                rows = np.arange(len(self._shape.levels[name].handles))
                self._shape.set(name, rows, share * np.asarray(moved[name], float))
            if not self._shape.folded():
                break
        return float(share)

    # -- what comes of it --------------------------------------------------------------------

    def texture(self, size: int = SIZE) -> tuple[Image, Image]:
        """(texture (size, size, 3), eyes), both RGB, of the mesh as it lies now.

        size: 256 for a preview, 512, 1024. Raises `UsageError` FIT-SIZE, `DataError` FACE-HIDDEN.
        """
        return self._live.make(self._shape.places(), size)

    def character(self) -> Character:
        """The character with the texture as it is now, of the size that it has."""
        old = self._character
        texture, eyes = self.texture(SIZE if old is None else old.texture.shape[0])
        if old is None:
            return Character("fitted", "", "", texture, eyes, self._landmarks)
        return replace(old, texture=texture, eyes=eyes)

    def face(self, mask: Mask, character: Character | None = None) -> Face:
        """The fitted character's face, ready for any expression."""
        return Face(character or self.character(), mask)

    # -- checks ------------------------------------------------------------------------------

    def _put(self, step: Step | None, before: bool) -> bool:
        for change in step or ():
            self._shape.set(change.level, change.rows, change.before if before else change.after)
        return step is not None

    def _held(self) -> Pull:
        if self._pull is None:
            raise UsageError("FIT-DRAG", "no handle is held", "Begin a drag with a handle first.")
        return self._pull

    def _rest(self, wanted: str) -> None:
        if self._pull is not None:
            raise UsageError(
                "FIT-DRAG",
                f"cannot {wanted} while {self.dragging} is held",
                "End or cancel the drag first.",
            )
