"""The error tree, under the show's own name, so that computing packages import no driver."""

from hypermask_drivers.errors import (
    ConfigError,
    DataError,
    DeviceAbsent,
    DeviceError,
    DeviceLost,
    HypermaskError,
    UsageError,
)

__all__ = [
    "ConfigError",
    "DataError",
    "DeviceAbsent",
    "DeviceError",
    "DeviceLost",
    "HypermaskError",
    "UsageError",
]
