"""TOML into typed models; an unknown key is an error that names file, key and the nearest one."""

from __future__ import annotations

import difflib
import tomllib
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from hypermask_drivers.errors import ConfigError

Model = TypeVar("Model", bound="Settings")


class Settings(BaseModel):
    """Base of every configuration table: immutable, no unknown keys, no NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def read_toml(path: Path) -> dict[str, Any]:
    """Raises `ConfigError` CFG-ABSENT, CFG-READ or CFG-SYNTAX."""
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise ConfigError("CFG-ABSENT", f"there is no file {path}", "Check the path.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("CFG-READ", f"cannot read {path}: {error}", "Check the file.") from error
    except (ValueError, RecursionError) as error:  # also numbers and nests beyond all measure
        raise ConfigError(
            "CFG-SYNTAX", f"{path} is not valid TOML: {error}", "Mend the line it names."
        ) from error


def parse(model: type[Model], data: dict[str, Any], source: str) -> Model:
    """Validate `data` against `model`; `source` names the file in messages.

    Raises `ConfigError` CFG-KEY (unknown key), CFG-MISSING (absent key) or CFG-VALUE (wrong value).
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise _explain(error, model, source) from None


def load(model: type[Model], path: Path) -> Model:
    return parse(model, read_toml(path), str(path))


def override(data: dict[str, Any], assignments: list[str]) -> dict[str, Any]:
    """Apply ``key.path=value`` assignments to nested tables; a copy is returned.

    The value is read as TOML (`3`, `true`, `[1, 2]`, `"x"`), and as a plain string where it is not.
    Raises `ConfigError` SET-FORM for an assignment without '='.
    """
    import copy

    result = copy.deepcopy(data)
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        if not equals or not key.strip():
            raise ConfigError(
                "SET-FORM", f"'{assignment}' is not key=value", "Write --set table.key=value."
            )
        table = result
        *folders, leaf = key.strip().split(".")
        for folder in folders:
            inner = table.setdefault(folder, {})
            if not isinstance(inner, dict):
                raise ConfigError(
                    "CFG-VALUE", f"--set {key}: '{folder}' is not a table", "Check the key."
                )
            table = inner
        table[leaf] = _value(text)
    return result


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def _explain(error: ValidationError, model: type[BaseModel], source: str) -> ConfigError:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        known = _known_keys(model, first["loc"][:-1])
        near = difflib.get_close_matches(str(first["loc"][-1]), known, n=1, cutoff=0.4)
        hint = f"Did you mean '{near[0]}'?" if near else f"Known here: {', '.join(known)}."
        return ConfigError("CFG-KEY", f"{source}: unknown key '{key}'", hint)
    if first["type"] == "missing":
        return ConfigError("CFG-MISSING", f"{source}: the key '{key}' is missing", "Add it.")
    return ConfigError(
        "CFG-VALUE",
        f"{source}: '{key}' = {first['input']!r} is wrong: {first['msg']}",
        "Correct the value.",
    )


def _known_keys(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    current: type[BaseModel] | None = model
    for part in location:
        if current is None or part not in current.model_fields:
            continue
        current = _model_in(current.model_fields[str(part)].annotation)
    return sorted(current.model_fields) if current is not None else []


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The first settings model inside an annotation such as `X`, `X | None`, `list[X]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if isinstance(annotation, types.GenericAlias | types.UnionType) or typing.get_args(annotation):
        for argument in typing.get_args(annotation):
            found = _model_in(argument)
            if found is not None:
                return found
    return None
