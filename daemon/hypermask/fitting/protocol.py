"""The fitting session in JSON: one request, one answer, for a web page or a file of drags.

{"do": "state"}                                  size, levels, mirror, undo and redo, what is held
{"do": "handles", "level": L}                    name, x, y, mirror and whether moved, of each
{"do": "mesh"}                                   vertices in pixels, triangles
{"do": "nearest", "level": L, "x", "y", "radius"}
{"do": "begin", "handle": H}, {"do": "move", "x", "y"}, {"do": "end"}, {"do": "cancel"}
{"do": "drag", "handle": H, "x", "y"}            a whole drag; or "by": [dx, dy] from where it is
{"do": "undo"}, {"do": "redo"}, {"do": "reset"}, {"do": "reset", "level": L}
{"do": "mirror", "on": true}
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hypermask.errors import HypermaskError, UsageError
from hypermask.face.mesh import load_mesh
from hypermask.fitting.checks import finite, fold_notice, known_level
from hypermask.fitting.handles import LEVELS, load_levels
from hypermask.fitting.session import Dragged, Fitting

Answer = dict[str, Any]


def respond(fitting: Fitting, request: Any) -> Answer:
    """`answer` for a program: {"ok": true, ...}, or {"ok": false, "error": code, what, remedy}."""
    try:
        return {"ok": True, **answer(fitting, request)}
    except HypermaskError as error:
        return {"ok": False, "error": words(error)}


def answer(fitting: Fitting, request: Any) -> Answer:
    """Do what a request says. Raises `UsageError` FIT-REQUEST and those of `Fitting`."""
    if not isinstance(request, Mapping):
        raise _wrong("it is no object with names and values")
    wanted = dict(request)
    do = wanted.pop("do", "drag" if "handle" in wanted else None)
    if not isinstance(do, str) or do not in _KNOWN:
        raise _wrong(f"'do' is {do!r}; known: {', '.join(_KNOWN)}")
    call, needed, optional = _KNOWN[do]
    missing = [name for name in needed if name not in wanted]
    unknown = [name for name in wanted if name not in (*needed, *optional)]
    if missing or unknown:
        fault = f"lacks '{missing[0]}'" if missing else f"has no use for '{unknown[0]}'"
        raise _wrong(f"'{do}' {fault}")
    return call(fitting, **wanted)


def state(fitting: Fitting) -> Answer:
    undo, redo = fitting.steps
    moved = fitting.moved
    levels = [
        {
            "name": name,
            "handles": len(load_levels()[name].handles),
            "moved": int(moved[name].any(axis=1).sum()),
        }
        for name in LEVELS
    ]
    return {
        "photo": {"width": fitting.size[0], "height": fitting.size[1]},
        "levels": levels,
        "mirror": fitting.mirror,
        "undo": undo,
        "redo": redo,
        "held": fitting.dragging,
    }


def handles(fitting: Fitting, level: Any) -> Answer:
    found = known_level(level, load_levels())
    moved = [bool(values.any()) for values in fitting.moved[found.name]]
    listed = [
        {"name": name, "x": x, "y": y, "mirror": fitting.mirrored(name), "moved": changed}
        for (name, (x, y)), changed in zip(fitting.handles(found.name).items(), moved, strict=True)
    ]
    return {"level": found.name, "handles": listed}


def words(error: HypermaskError) -> Answer:
    return {"code": error.code, "what": error.what, "remedy": error.remedy}


def _mesh(fitting: Fitting) -> Answer:
    places = np.round(fitting.vertices(), 2).tolist()
    return {"vertices": places, "triangles": load_mesh().triangles.tolist()}


def _nearest(fitting: Fitting, level: Any, x: Any, y: Any, radius: Any) -> Answer:
    return {"handle": fitting.nearest(level, x, y, radius)}


def _begin(fitting: Fitting, handle: Any) -> Answer:
    fitting.begin(handle)
    return state(fitting)


def _move(fitting: Fitting, x: Any, y: Any) -> Answer:
    return _told(fitting.move(x, y))


def _end(fitting: Fitting) -> Answer:
    return {"changed": fitting.end(), **state(fitting)}


def _cancel(fitting: Fitting) -> Answer:
    fitting.cancel()
    return state(fitting)


def _drag(fitting: Fitting, handle: Any, x: Any = None, y: Any = None, by: Any = None) -> Answer:
    if by is not None:
        if x is not None or y is not None or not isinstance(by, list | tuple) or len(by) != 2:
            raise _wrong("'by' is [dx, dy], without x and y")
        fitting.mirrored(handle)  # a handle that is not there is told first
        at = fitting.handles(handle.split("/")[0])[handle]
        x, y = at[0] + finite(by[0]), at[1] + finite(by[1])
    elif x is None or y is None:
        raise _wrong("'drag' lacks 'x' and 'y', or 'by'")
    return _told(fitting.drag(handle, x, y))


def _reset(fitting: Fitting, level: Any = None) -> Answer:
    return {"changed": fitting.reset(level), **state(fitting)}


def _set_mirror(fitting: Fitting, on: Any) -> Answer:
    if not isinstance(on, bool):
        raise _wrong("'on' is neither true nor false")
    fitting.mirror = on
    return state(fitting)


def _told(done: Dragged) -> Answer:
    told: Answer = {
        "handle": done.handle,
        "x": done.place[0],
        "y": done.place[1],
        "share": done.share,
        "mirror": done.mirror,
    }
    if done.held:
        told["notice"] = words(fold_notice(done.handle))
    return told


_KNOWN: dict[str, tuple[Callable[..., Answer], tuple[str, ...], tuple[str, ...]]] = {
    "state": (state, (), ()),
    "handles": (handles, ("level",), ()),
    "mesh": (_mesh, (), ()),
    "nearest": (_nearest, ("level", "x", "y", "radius"), ()),
    "begin": (_begin, ("handle",), ()),
    "move": (_move, ("x", "y"), ()),
    "end": (_end, (), ()),
    "cancel": (_cancel, (), ()),
    "drag": (_drag, ("handle",), ("x", "y", "by")),
    "undo": (lambda f: {"changed": f.undo(), **state(f)}, (), ()),
    "redo": (lambda f: {"changed": f.redo(), **state(f)}, (), ()),
    "reset": (_reset, (), ("level",)),
    "mirror": (_set_mirror, ("on",), ()),
}


def _wrong(why: str) -> UsageError:
    return UsageError(
        "FIT-REQUEST",
        f"the request cannot be meant: {why}",
        'An example: {"do": "drag", "handle": "parts/brow_left", "by": [0, -4]}.',
    )
