"""The one error tree: a stable code, what happened, and what to do about it.

The command line, the journal, the API and the handbook all print `str(error)`.
"""

from __future__ import annotations


class HypermaskError(Exception):
    """Anything a user can be told about.

    Parameters
    ----------
    code: stable upper-case code, e.g. ``CAM-LOST``; it never changes once released.
    what: what happened, one sentence without its final full stop.
    remedy: what to do, one or more sentences.
    """

    exit_code = 1

    def __init__(self, code: str, what: str, remedy: str) -> None:
        super().__init__(code, what, remedy)
        self.code = code
        self.what = what
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.code}: {self.what}. {self.remedy}"


class UsageError(HypermaskError):
    """The caller asked for something that cannot be meant: exit code 2."""

    exit_code = 2


class ConfigError(UsageError):
    """A configuration, scenario or show file is absent, unreadable or wrong."""


class DataError(HypermaskError):
    """A file with a user's data (photo, recording, calibration) cannot be used."""


class DeviceError(HypermaskError):
    """A device is absent, lost, or refuses what it was asked."""


class DeviceAbsent(DeviceError):
    """The device was not there when it was opened."""


class DeviceLost(DeviceError):
    """The device was there and vanished; `open` may be tried again."""
