"""TOML into typed models, under the show's own name (see `hypermask_drivers.settings`)."""

from hypermask_drivers.settings import Settings, load, override, parse, read_toml

__all__ = ["Settings", "load", "override", "parse", "read_toml"]
