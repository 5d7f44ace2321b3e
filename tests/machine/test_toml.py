"""What is written as TOML is read back the same."""

from __future__ import annotations

import tomllib

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hypermask.machine.toml import dumps

plain = (
    st.text(st.characters(codec="utf-8"), max_size=8)
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.booleans()
)
values = st.recursive(
    plain,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None, derandomize=True)
@given(st.dictionaries(st.text(st.characters(codec="utf-8"), max_size=8), values, max_size=3))
def test_every_table_comes_back(table: dict[str, object]) -> None:
    assert tomllib.loads(dumps(table)) == table


def test_what_is_none_is_left_out() -> None:
    assert tomllib.loads(dumps({"a": None, "b": {"c": None, "d": 1}})) == {"b": {"d": 1}}


def test_tables_are_written_as_tables() -> None:
    assert dumps({"version": 1, "camera": {"driver": "v4l2"}}) == (
        'version = 1\n\n[camera]\ndriver = "v4l2"\n'
    )
