"""Messages between the node's process and its trainer: JSON, arrays, shared memory; nothing executable."""

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
    """A stream socket that carries whole messages; sending is safe from several threads.

    Raises:
        ConnectionError: on every call, once the other side is gone.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._sending = threading.Lock()

    @classmethod
    def pair(cls) -> tuple[Channel, socket.socket]:
        """A channel and the socket for the other side."""
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        return cls(here), there

    def fileno(self) -> int:
        """For select."""
        return self._socket.fileno()

    def give_up_after(self, seconds: float) -> None:
        """Have `receive` fail where the next part of a message does not come for so long [s]."""
        self._socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", *divmod(round(seconds * 1e6), 10**6))
        )

    def send(self, message: Message) -> None:
        """Send one message; waits while the other side is slow."""
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
        """The next message; waits for it."""
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
        """End it for both sides: `receive` fails after what came already, also where it waits."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Hang up, and give the socket back."""
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
    """Have a process at the other side of a channel end with that, and not by a signal to stop.

    A terminal, or systemd at a stop, sends it to every process: the node decides when its own may go.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def close_all(message: Message) -> None:
    """Close descriptors that nobody wants."""
    for descriptor in message.descriptors:
        os.close(descriptor)
