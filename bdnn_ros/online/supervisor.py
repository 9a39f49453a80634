"""The node's side of training: starts the trainer, hears it, and starts it again if it dies or hangs."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence

from bdnn_ros.errors import BdnnError
from bdnn_ros.online.buffer import Ring
from bdnn_ros.online.channel import Channel, Message

TRAINER = (sys.executable, "-m", "bdnn_ros.online.trainer")
HANG = 60.0
"""A trainer silent for so long [s] hangs and is replaced."""
RESTART_PAUSE = (0.1, 5.0)
"""First and longest pause before a trainer that died is started again [s]."""
STEADY = 30.0
"""A trainer that lived so long [s] is started again at once."""
READY, LOST = "ready", "lost"


class Supervisor:
    """Keeps one trainer process alive.

    Messages from the trainer reach `hear` in this object's own thread, and one of kind `LOST` when it is gone, or
    could not be started; what a new trainer must know is asked of `introduce`: the messages that begin its work.

    Attributes:
        restarts: how often a trainer was replaced.
        trouble: why the last one ended, empty if none did.
    """

    def __init__(
        self,
        hear: Callable[[Message], None],
        introduce: Callable[[], Sequence[Message]],
        command: Sequence[str] = TRAINER,
        niceness: int = 10,
    ) -> None:
        self.restarts = 0
        self.trouble = ""
        self.ring: Ring | None = None
        self._hear = hear
        self._introduce = introduce
        self._command = list(command)
        self._niceness = niceness
        self._outbox: deque[Message] = deque()
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self._stopping = threading.Event()
        self._ready = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)

    @property
    def alive(self) -> bool:
        """A trainer runs and has said that it is ready."""
        process = self._process
        return process is not None and process.poll() is None and self._ready.is_set()

    @property
    def pid(self) -> int:
        """Process id of the trainer, 0 if there is none."""
        process = self._process
        return 0 if process is None or process.poll() is not None else process.pid

    def start(self) -> None:
        """Start the thread and with it the trainer; returns at once."""
        self._thread.start()

    def send(self, message: Message) -> None:
        """Hand a message over to the trainer; returns at once, and is dropped if the trainer dies before.

        What is sent after a `LOST` was heard reaches the next trainer.
        """
        self._outbox.append(message)
        with contextlib.suppress(BlockingIOError, OSError):
            os.write(self._wake_write, b"x")

    def stop(self, patience: float = 5.0) -> None:
        """End the trainer: asked first, killed after `patience` [s]. No process is left."""
        self.send(Message("stop"))
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(patience)
        self._kill()
        if self._thread.is_alive():
            self._thread.join(5.0)
        for descriptor in (self._wake_read, self._wake_write):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    # -- the thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        pause = RESTART_PAUSE[0]
        while not self._stopping.is_set():
            born = time.monotonic()
            try:
                self._keep_one()
            except ConnectionError:
                pass  # `_end` says why
            except OSError as error:  # the machine has no room for another process, or another descriptor
                self.trouble = f"it cannot be run: {error.strerror or error}"
            except Exception as error:  # nobody else would start the next one
                self._tell(error)
            self._outbox.clear()  # before it is told: what is asked after that, the next one answers
            self._listen(Message(LOST, {"ran": self._process is not None}))
            if self._stopping.is_set():
                return
            self.restarts += 1
            pause = (
                RESTART_PAUSE[0] if time.monotonic() - born > STEADY else min(2.0 * pause, RESTART_PAUSE[1])
            )
            self._stopping.wait(pause)

    def _keep_one(self) -> None:
        """Start a trainer, carry its messages, and see it off.

        Raises:
            OSError: it could not be started, or it ended.
        """
        self._process = None
        channel, there = Channel.pair()
        try:
            with there:
                self._spawn(there.fileno())
            self._converse(channel)
        finally:
            self._ready.clear()
            channel.close()
            self._end()

    def _spawn(self, descriptor: int) -> None:
        environment = {
            **os.environ,
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "MKL_NUM_THREADS": "1",
            "MALLOC_ARENA_MAX": "1",  # what one thread gave back, the other uses
        }
        command = [*self._command, "--channel", str(descriptor), "--nice", str(self._niceness)]
        self._process = subprocess.Popen(
            command, pass_fds=[descriptor], env=environment, stdin=subprocess.DEVNULL
        )

    def _converse(self, channel: Channel) -> None:
        """Carry messages both ways until the trainer is gone or the work is done."""
        while True:
            readable, _, _ = select.select([channel.fileno(), self._wake_read], [], [], 1.0)
            if channel.fileno() in readable:
                message = channel.receive()
                if message.kind == READY:
                    for introduction in self._introduce():
                        channel.send(introduction)
                    self._ready.set()
                else:
                    self._listen(message)
            if self._wake_read in readable:
                os.read(self._wake_read, 4096)
            while self._outbox and self._ready.is_set():
                channel.send(self._outbox.popleft())
            if self._stopping.is_set() and not self._ready.is_set():
                return
            if self.ring is not None and self._ready.is_set() and HANG < self.ring.silence < float("inf"):
                self.trouble = f"silent for {self.ring.silence:.0f} s"
                return

    def _listen(self, message: Message) -> None:
        """Hear a message; one that cannot be used must not end this thread."""
        try:
            self._hear(message)
        except Exception as error:
            self._tell(error)

    def _tell(self, error: Exception) -> None:
        """Keep it as the trouble; where it is an error of the program, print it, too."""
        self.trouble = str(error)
        if not isinstance(error, BdnnError):
            traceback.print_exc()
            self.trouble = f"the node's side of it failed: {type(error).__name__}"

    def _end(self) -> None:
        """See the process off: whatever it is doing, nothing it holds is needed any more."""
        process = self._process
        if process is None:
            return
        try:
            status = process.wait(0.5)
            if not self._stopping.is_set():
                self.trouble = (
                    f"ended by {signal.Signals(-status).name}" if status < 0 else f"exited with {status}"
                )
        except subprocess.TimeoutExpired:
            self._kill()

    def _kill(self) -> None:
        process = self._process
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()
