"""Messages between the node process and the trainer process: JSON, numeric arrays, file descriptors; nothing executable."""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from safetensors.numpy import load, save

_HEAD = struct.Struct("<QQB")
_MOST_DESCRIPTORS = 4


@dataclass(frozen=True)
class Message:
    """One message.

    Attributes:
        kind: what it is about, as "version".
        info: JSON-able rest.
        arrays: numeric arrays by name.
        descriptors: open file descriptors that came along; the receiver owns them.
    """

    kind: str
    info: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    descriptors: tuple[int, ...] = ()


class Channel:
    """A stream socket that carries whole messages; several threads may send.

    Raises:
        ConnectionError: on every call, once the other side is gone.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._sending = threading.Lock()

    @classmethod
    def pair(cls) -> tuple[Channel, socket.socket]:
        """A channel, and the socket for the other process."""
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        return cls(here), there

    def fileno(self) -> int:
        """For select."""
        return self._socket.fileno()

    def give_up_after(self, seconds: float) -> None:
        """Let `receive` fail if the rest of a message does not arrive within so long [s]."""
        self._socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", *divmod(round(seconds * 1e6), 10**6))
        )

    def send(self, message: Message) -> None:
        """Send one message; blocks while the receiver is slow."""
        text = json.dumps({"kind": message.kind, "info": message.info}).encode()
        arrays = {key: np.ascontiguousarray(value) for key, value in message.arrays.items()}
        blob = save(arrays) if arrays else b""
        head = _HEAD.pack(len(text), len(blob), len(message.descriptors))
        with self._sending:
            try:
                if message.descriptors:
                    socket.send_fds(self._socket, [head], list(message.descriptors))
                else:
                    self._socket.sendall(head)
                self._socket.sendall(text)
                self._socket.sendall(blob)
            except OSError as error:
                raise ConnectionError(str(error)) from None

    def receive(self) -> Message:
        """Wait for the next message and return it."""
        try:
            head, descriptors, _, _ = socket.recv_fds(self._socket, _HEAD.size, _MOST_DESCRIPTORS)
            head += self._exactly(_HEAD.size - len(head)) if head else b""
            if not head:
                raise ConnectionError("the other side is gone")
            text_size, blob_size, _ = _HEAD.unpack(head)
            header = json.loads(self._exactly(text_size))
            blob = self._exactly(blob_size)
        except BlockingIOError:
            raise ConnectionError("silent in the middle of a message") from None
        except OSError as error:
            raise ConnectionError(str(error)) from None
        arrays = load(blob) if blob else {}
        return Message(header["kind"], header["info"], arrays, tuple(descriptors))

    def hang_up(self) -> None:
        """Shut the connection down for both sides: a waiting `receive` fails once it has returned what was sent before."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Hang up and close the socket."""
        self.hang_up()
        self._socket.close()

    def _exactly(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            part = self._socket.recv(min(size - len(data), 1 << 20))
            if not part:
                raise ConnectionError("the other side is gone")
            data += part
        return bytes(data)


def leave_signals_to_the_node() -> None:
    """Ignore SIGINT, SIGTERM and SIGHUP in a helper process; it ends when its channel does.

    A terminal or systemd signals every process of the group, but the node decides when its helpers may stop.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def close_all(message: Message) -> None:
    """Close the file descriptors of a message that is not used."""
    for descriptor in message.descriptors:
        os.close(descriptor)
