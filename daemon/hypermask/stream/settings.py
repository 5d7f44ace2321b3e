"""The table [stream] of a machine's settings."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from hypermask.config import Settings, parse, read_toml
from hypermask.errors import ConfigError

PORT = 47310


class SendSettings(Settings):
    """host, port: of the other hypermask. key_file: at least 16 bytes that both share."""

    on: bool = False
    host: str = Field("127.0.0.1", min_length=1, max_length=253)
    port: int = Field(PORT, ge=1, le=65535)
    key_file: Path | None = None
    mouth: bool = True
    expression: bool = True
    head: bool = True


class ReceiveSettings(Settings):
    """host, port: of this machine, to listen at. senders: addresses that are heard, any if empty.

    buffer_ms: how much later all is played than it was performed; 60 ms of it are the datagram's,
    the rest takes up the network's unevenness, from 80 ms on also a lost datagram.
    head: the other's head moves the face; only for a face that is on no tracked mask.
    """

    on: bool = False
    host: str = Field("127.0.0.1", min_length=1, max_length=253)
    port: int = Field(PORT, ge=1, le=65535)
    key_file: Path | None = None
    senders: tuple[str, ...] = Field((), max_length=32)
    buffer_ms: float = Field(180.0, ge=80, le=1000)
    mouth: bool = True
    expression: bool = True
    head: bool = False


class StreamSettings(Settings):
    send: SendSettings = SendSettings()
    receive: ReceiveSettings = ReceiveSettings()


def load_stream(path: Path) -> StreamSettings:
    """The table [stream] of a machine's file. Raises `ConfigError` CFG-*."""
    return parse(StreamSettings, read_toml(path).get("stream", {}), str(path))


def load_key(path: Path | None) -> bytes | None:
    """Raises `ConfigError` STREAM-KEY: absent, too short, or readable by everybody."""
    if path is None:
        return None
    remedy = "Make one with: (umask 077; head -c 32 /dev/urandom | base64 > FILE), for both sides."
    try:
        key = path.read_bytes().strip()
        mode = path.stat().st_mode
    except OSError as error:
        raise ConfigError(
            "STREAM-KEY", f"cannot read the key {path}: {error.strerror}", remedy
        ) from None
    if len(key) < 16:
        raise ConfigError("STREAM-KEY", f"the key {path} is shorter than 16 bytes", remedy)
    if mode & 0o007:
        raise ConfigError(
            "STREAM-KEY", f"everybody on this machine may read the key {path}", "chmod o= it."
        )
    return key
