"""The session in JSON, as a web page speaks with it."""

from __future__ import annotations

import json

import pytest
from fitting_faces import fitting
from hypothesis import given, settings
from hypothesis import strategies as st

from hypermask.fitting.handles import LEVELS
from hypermask.fitting.protocol import respond
from hypermask.fitting.session import Fitting


@pytest.fixture(scope="module")
def shared() -> Fitting:
    return fitting()


def _ask(session: Fitting, **request: object) -> dict:
    answer = respond(session, request)
    return json.loads(json.dumps(answer, allow_nan=False))


def test_state_and_handles_are_json() -> None:
    session = fitting()
    state = _ask(session, do="state")
    assert state["ok"] and state["photo"] == {"width": 760, "height": 900}
    assert [level["name"] for level in state["levels"]] == list(LEVELS)
    assert (state["mirror"], state["undo"], state["redo"], state["held"]) == (False, 0, 0, None)
    listed = _ask(session, do="handles", level="face")["handles"]
    assert [entry["name"] for entry in listed] == ["face/eye_left", "face/eye_right", "face/mouth"]
    assert listed[0]["mirror"] == "face/eye_right" and not listed[0]["moved"]
    mesh = _ask(session, do="mesh")
    assert max(max(t) for t in mesh["triangles"]) < len(mesh["vertices"])


def test_a_drag_goes_begin_move_end_with_undo() -> None:
    session = fitting()
    at = _ask(session, do="handles", level="parts")["handles"][0]
    found = _ask(session, do="nearest", level="parts", x=at["x"] + 1, y=at["y"], radius=9)
    assert found["handle"] == at["name"]
    assert _ask(session, do="begin", handle=at["name"])["held"] == at["name"]
    moved = _ask(session, do="move", x=at["x"], y=at["y"] - 3)
    assert moved["y"] == pytest.approx(at["y"] - 3) and moved["share"] == 1
    assert "notice" not in moved
    ended = _ask(session, do="end")
    assert ended["changed"] and ended["undo"] == 1 and ended["levels"][1]["moved"] == 1
    assert _ask(session, do="undo")["redo"] == 1
    assert _ask(session, do="redo")["undo"] == 1
    assert _ask(session, do="reset", level="parts")["changed"]
    assert not _ask(session, do="reset")["changed"]


def test_a_whole_drag_by_an_offset_says_when_it_was_held() -> None:
    session = fitting()
    assert _ask(session, do="mirror", on=True)["mirror"]
    done = _ask(session, handle="features/cheek_left", by=[1, 1])
    assert done["ok"] and done["mirror"] == "features/cheek_right"
    held = _ask(session, do="drag", handle="points/4", by=[250, 0])
    assert held["ok"] and held["share"] < 1
    assert held["notice"]["code"] == "FIT-FOLD" and held["notice"]["remedy"]


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (None, "FIT-REQUEST"),
        ([], "FIT-REQUEST"),
        ({}, "FIT-REQUEST"),
        ({"do": "dance"}, "FIT-REQUEST"),
        ({"do": ["state"]}, "FIT-REQUEST"),
        ({"do": "begin"}, "FIT-REQUEST"),
        ({"do": "state", "level": "face"}, "FIT-REQUEST"),
        ({"do": "mirror", "on": 1}, "FIT-REQUEST"),
        ({"do": "drag", "handle": "parts/nose"}, "FIT-REQUEST"),
        ({"do": "drag", "handle": "parts/nose", "x": 1}, "FIT-REQUEST"),
        ({"do": "drag", "handle": "parts/nose", "by": [1]}, "FIT-REQUEST"),
        ({"do": "drag", "handle": "parts/nose", "by": [1, 2], "x": 4}, "FIT-REQUEST"),
        ({"do": "drag", "handle": "parts/nose", "by": [1, None]}, "FIT-PLACE"),
        ({"do": "drag", "handle": "parts/nose", "x": "1", "y": 2}, "FIT-PLACE"),
        ({"do": "drag", "handle": {}, "by": [1, 2]}, "FIT-HANDLE"),
        ({"do": "drag", "handle": None, "by": [1, 2]}, "FIT-HANDLE"),
        ({"do": "handles", "level": ["face"]}, "FIT-LEVEL"),
        ({"do": "reset", "level": 4}, "FIT-LEVEL"),
        ({"do": "move", "x": 1, "y": 2}, "FIT-DRAG"),
        ({"do": "end"}, "FIT-DRAG"),
    ],
)
def test_a_wrong_request_is_answered_with_its_code(
    shared: Fitting, request_: object, code: str
) -> None:
    answer = respond(shared, request_)
    assert not answer["ok"] and answer["error"]["code"] == code
    assert answer["error"]["what"] and answer["error"]["remedy"]
    assert shared.steps == (0, 0) and shared.dragging is None


_VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.sampled_from(["face", "parts", "parts/nose", "points/4", "drag", ""]),
    st.text(max_size=6),
    st.lists(st.floats(-400, 400), max_size=3),
)
_REQUESTS = st.dictionaries(
    st.sampled_from(["handle", "x", "y", "by", "level", "on", "radius", "z"]), _VALUES, max_size=4
)
_DO = ["state", "nearest", "begin", "move", "end", "cancel", "drag", "undo", "redo", "reset"]


@settings(max_examples=300, deadline=None)
@given(do=st.sampled_from([*_DO, "mirror", "handles", "?"]), rest=_REQUESTS)
def test_no_request_whatever_is_answered_with_a_crash(
    shared: Fitting, do: str, rest: dict[str, object]
) -> None:
    answer = respond(shared, {"do": do, **rest})
    json.dumps(answer, allow_nan=False)
    assert answer["ok"] or answer["error"]["code"].startswith("FIT-")
