"""The show's control socket: one JSON request, one JSON answer, each one packet.

A Unix socket (SOCK_SEQPACKET) in `paths.run()`, for the group hypermask only; nothing listens on
the network. Everything is done without waiting, a few packets at each step: a client that sends
rubbish, half a message or nothing, or that never reads, costs the show nothing.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypermask import paths
from hypermask.errors import HypermaskError, UsageError

Table = dict[str, Any]
Handler = Callable[[Table], Table]
"""Answers a request. May raise `HypermaskError`."""

GROUP = "hypermask"
MODE = 0o660
LONGEST = 16 * 1024
"""Bytes of a request; of an answer four times that."""
MOST_CLIENTS = 32
IDLE_S = 30.0
_AT_ONCE = 8


def socket_path() -> Path:
    return paths.run() / "control.sock"


class ControlServer:
    """Serves `handler`. When it is full, whoever has been silent longest has to go.

    Raises `HypermaskError` CTL-BUSY (another show serves there), CTL-SOCKET (it cannot be made).
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or socket_path()
        self._clients: dict[socket.socket, float] = {}
        self._socket = self._listen()

    def _listen(self) -> socket.socket:
        _remove_stale(self.path)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            listener.setblocking(False)
            listener.bind(str(self.path))
            with contextlib.suppress(OSError, LookupError):  # a developer's machine has no group
                shutil.chown(self.path, group=GROUP)
            self.path.chmod(MODE)
            listener.listen(MOST_CLIENTS)
        except OSError as error:
            listener.close()
            raise HypermaskError(
                "CTL-SOCKET",
                f"cannot listen at {self.path}: {error.strerror or error}",
                "Check the folder's rights; the show can be steered by the keypad only.",
            ) from error
        return listener

    @property
    def clients(self) -> int:
        return len(self._clients)

    def step(self, now_s: float, handler: Handler) -> int:
        """Accept who knocks, answer a few requests; returns how many. Never waits, never raises."""
        self._accept(now_s)
        answered = 0
        # Longest silent first, so that nobody who sends all the time keeps others out.
        for client in sorted(self._clients, key=lambda client: self._clients[client]):
            if answered >= _AT_ONCE:
                break
            answered += self._serve(client, now_s, handler)
        for client, heard_s in list(self._clients.items()):
            if now_s - heard_s > IDLE_S:
                self._drop(client)
        return answered

    def close(self) -> None:
        for client in list(self._clients):
            self._drop(client)
        self._socket.close()
        with contextlib.suppress(OSError):
            self.path.unlink()

    def _accept(self, now_s: float) -> None:
        for _ in range(_AT_ONCE):
            try:
                client, _ = self._socket.accept()
            except OSError:  # nobody knocks, or there are no more file descriptors
                return
            client.setblocking(False)
            if len(self._clients) >= MOST_CLIENTS:
                self._drop(min(self._clients, key=lambda known: self._clients[known]))
            self._clients[client] = now_s

    def _serve(self, client: socket.socket, now_s: float, handler: Handler) -> int:
        try:
            data, _, flags, _ = client.recvmsg(LONGEST)
        except BlockingIOError:
            return 0
        except OSError:
            self._drop(client)
            return 0
        if not data:
            self._drop(client)
            return 0
        self._clients[client] = now_s
        answer = json.dumps(_answer(data, bool(flags & socket.MSG_TRUNC), handler), default=str)
        try:
            client.send(answer.encode())
        except OSError:  # it does not read, or is gone
            self._drop(client)
        return 1

    def _drop(self, client: socket.socket) -> None:
        self._clients.pop(client, None)
        client.close()


def _answer(data: bytes, cut: bool, handler: Handler) -> Table:
    try:
        if cut:
            raise UsageError(
                "CTL-SIZE", f"a request is longer than {LONGEST} bytes", "Send a shorter one."
            )
        return {"ok": True, **handler(_parsed(data))}
    except HypermaskError as error:
        return failure(error)
    except Exception as error:  # a fault in here must not end the show
        text = " ".join(str(error).split())
        return failure(
            HypermaskError(
                "CTL-FAULT",
                f"the request could not be carried out ({type(error).__name__}: {text})",
                "Send us the bundle (hypermask bundle).",
            )
        )


def _parsed(data: bytes) -> Table:
    try:
        request = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise UsageError("CTL-JSON", "a request is not JSON", "Send one whole object.") from error
    if not isinstance(request, dict):
        raise UsageError("CTL-JSON", "a request is not an object", 'Send {"do": ...}.')
    return request


def failure(error: HypermaskError) -> Table:
    """An error as an answer."""
    told = {"code": error.code, "what": error.what, "remedy": error.remedy}
    return {"ok": False, "error": told | {"exit": error.exit_code}}


def _remove_stale(path: Path) -> None:
    """A socket that nobody serves any more was left by a show that was killed."""
    probe = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    probe.setblocking(False)
    try:
        probe.connect(str(path))
    except (FileNotFoundError, ConnectionRefusedError):
        with contextlib.suppress(OSError):
            path.unlink()
        return
    except BlockingIOError:
        pass  # it is served, and busy
    except OSError:
        return  # whatever is wrong there, `bind` says it
    finally:
        probe.close()
    raise HypermaskError(
        "CTL-BUSY",
        f"another show serves {path}",
        "Stop that one (systemctl stop hypermask.target).",
    )


def ask(request: Table, path: Path | None = None, timeout_s: float = 3.0) -> Table:
    """A client's whole life: connect, ask, be answered.

    Raises `HypermaskError` CTL-NONE, CTL-RIGHTS, CTL-SILENT, CTL-JSON, and the answer's own.
    """
    path = path or _served()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as client:
        client.settimeout(timeout_s)
        try:
            client.connect(str(path))
            client.send(json.dumps(request).encode())
            data = client.recv(4 * LONGEST)
        except OSError as error:
            raise _unanswered(error, path) from error
    if not data:
        raise _unanswered(TimeoutError(), path)
    try:
        answer = json.loads(data)
    except ValueError as error:
        raise HypermaskError(
            "CTL-JSON", "the show's answer is no JSON", "Look at its journal (hypermask log)."
        ) from error
    return _checked(answer)


def _served() -> Path:
    """The first socket that is there, or may be: in a folder that may not be entered."""
    candidates = [run / socket_path().name for run in paths.run_folders()]
    for path in candidates:
        try:
            path.stat()
        except PermissionError:
            return path
        except OSError:
            continue
        return path
    return candidates[0]


def _checked(answer: Any) -> Table:
    if not isinstance(answer, dict):
        raise HypermaskError(
            "CTL-JSON", "the show's answer is no object", "Look at its journal (hypermask log)."
        )
    error = answer.get("error")
    if error is None:
        return answer
    kind = UsageError if error.get("exit") == 2 else HypermaskError
    raise kind(str(error.get("code")), str(error.get("what")), str(error.get("remedy")))


def _unanswered(error: OSError, path: Path) -> HypermaskError:
    if isinstance(error, FileNotFoundError | ConnectionRefusedError):
        return HypermaskError(
            "CTL-NONE",
            "no show is running on this machine that can be steered",
            "Start it: systemctl start hypermask.target.",
        )
    if isinstance(error, PermissionError):
        return HypermaskError(
            "CTL-RIGHTS",
            f"{path} may not be used by user {os.getuid()}",
            f"Join the group {GROUP} (adduser YOU {GROUP}, and log in again), or use sudo.",
        )
    if error.errno == errno.EMSGSIZE:
        return UsageError("CTL-SIZE", "the request is too long", "Send a shorter one.")
    return HypermaskError(
        "CTL-SILENT",
        "the show does not answer",
        "It may be starting; else look at its journal (hypermask log --worker show).",
    )
