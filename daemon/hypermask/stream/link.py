"""UDP sockets that never wait, IPv4 and IPv6."""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Sequence

from hypermask.errors import HypermaskError
from hypermask.stream.packet import LARGEST, LARGEST_IPV6

_RECEIVED = 2048


class UdpSender:
    """Datagrams to one place. Raises `HypermaskError` STREAM-HOST."""

    def __init__(self, host: str, port: int) -> None:
        family, self._address = _resolve(host, port)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.largest = LARGEST if family == socket.AF_INET else LARGEST_IPV6

    def send(self, data: bytes) -> None:
        """Raises `HypermaskError` STREAM-SEND: no network, no way, or no room."""
        try:
            self._socket.sendto(data, self._address)
        except OSError as error:
            raise HypermaskError(
                "STREAM-SEND",
                f"the stream cannot be sent to {self._address[0]}: {error.strerror or error}",
                "Check the network; it goes on by itself.",
            ) from None

    def close(self) -> None:
        self._socket.close()


class UdpReceiver:
    """Datagrams at one place, from some senders or any. Raises `HypermaskError` STREAM-HOST,
    STREAM-PORT.
    """

    def __init__(self, host: str, port: int, senders: Sequence[str] = ()) -> None:
        family, address = _resolve(host, port)
        self._allowed = {_plain(str(_resolve(name, port)[1][0])) for name in senders}
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise HypermaskError(
                "STREAM-PORT",
                f"cannot listen at {host}, port {port}: {error.strerror}",
                "Choose another port, or end the program that has it.",
            ) from None
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])
        self.strangers = 0

    def receive(self) -> tuple[bytes, str] | None:
        """The next datagram of a sender that is heard and its address, None if there is none."""
        for _ in range(64):
            try:
                data, address = self._socket.recvfrom(_RECEIVED)
            except (BlockingIOError, InterruptedError):
                return None
            except OSError:  # an ICMP message about something else
                continue
            sender = _plain(str(address[0]))
            if not self._allowed or sender in self._allowed:
                return data, sender
            self.strangers += 1
        return None

    def wait(self, seconds: float) -> None:
        """Until there is something, `seconds` at most."""
        with contextlib.suppress(OSError, ValueError):
            select.select([self._socket], [], [], max(seconds, 0.0))

    def close(self) -> None:
        self._socket.close()


def _resolve(host: str, port: int) -> tuple[socket.AddressFamily, tuple[str | int, ...]]:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as error:
        raise HypermaskError(
            "STREAM-HOST",
            f"there is no machine '{host}': {getattr(error, 'strerror', None) or error}",
            "Check the name, or give its address.",
        ) from None
    return family, tuple(part for part in address if isinstance(part, str | int))


def _plain(address: str) -> str:
    """Without the scope of IPv6, and IPv4 as itself."""
    return address.split("%")[0].removeprefix("::ffff:")
