"""Starts the trainer process, exchanges messages with it, and restarts it if it dies or hangs."""

from __future__ import annotations

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
from bdnn_ros.online.channel import Channel, Message
from bdnn_ros.online.stream.buffer import Ring

TRAINER = (sys.executable, "-m", "bdnn_ros.online.trainer")
HANG = 120.0
"""A trainer silent for so long [s] hangs and is replaced: where 28 joints learn on cores that others want as well, the longest
step between two signs of life takes half a minute."""
RESTART_PAUSE = (0.1, 5.0)
"""First and longest pause before a trainer that died is started again [s]."""
PATIENCE = 3.0
"""A trainer that was asked to end is waited for so long [s]: after five, whoever launched the node asks it less kindly."""
STEADY = 30.0
"""A trainer that lived so long [s] is started again at once."""
READY, LOST = "ready", "lost"


class Supervisor:
    """Keeps one trainer process running.

    Messages of the trainer are passed to `hear` in the supervisor's own thread, and one of kind `LOST` when the trainer has
    ended or could not start. `introduce` returns the messages that begin the work of a new trainer.

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
        self._posted = threading.Event()
        self._stopping = threading.Event()
        self._ready = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)

    @property
    def alive(self) -> bool:
        """Whether a trainer runs and has reported that it is ready."""
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
        """Queue a message for the trainer and return; it is dropped if the trainer dies first.

        Messages sent after `LOST` was heard reach the next trainer.
        """
        self._outbox.append(message)
        self._posted.set()

    def stop(self, patience: float = PATIENCE) -> bool:
        """End the trainer: on request, or killed after `patience` [s]. No process is left.

        Returns:
            Whether it was done in time.
        """
        self.send(Message("stop"))
        self._stopping.set()
        if not self._ready.is_set():
            self._kill()  # it has not begun, and hears nothing yet
        if self._thread.is_alive():
            self._thread.join(patience)
        done = not self._thread.is_alive()
        self._kill()
        if not done:
            self._thread.join(5.0)
        return done

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
        """Start a trainer, exchange messages until it ends, and clean up.

        Raises:
            OSError: it could not be started, or it ended.
        """
        self._process = None
        channel, there = Channel.pair()
        over = threading.Event()
        writer = threading.Thread(
            target=self._write, args=(channel, over), name="to the trainer", daemon=True
        )
        try:
            with there:
                self._spawn(there.fileno())
            writer.start()
            self._converse(channel)
        except ConnectionError as error:
            self.trouble = str(error)  # `_end` says more where the process is gone
            raise
        finally:
            self._ready.clear()
            over.set()
            self._posted.set()
            channel.close()
            if writer.ident is not None:
                writer.join()
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
        # in a session of its own: a terminal's Ctrl-C is for the node, also before the trainer could say so itself
        self._process = subprocess.Popen(
            command,
            pass_fds=[descriptor],
            env=environment,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )

    def _converse(self, channel: Channel) -> None:
        """Receive from the trainer until it ends or the supervisor is stopped."""
        channel.give_up_after(HANG)
        ready = time.monotonic()
        while True:
            readable, _, _ = select.select([channel], [], [], 1.0)
            if readable:
                message = channel.receive()
                if message.kind == READY:
                    self._acquaint()
                    ready = time.monotonic()
                else:
                    self._listen(message)
            if self._stopping.is_set() and not self._ready.is_set():
                return
            silence = self.ring.silence if self.ring is not None and self._ready.is_set() else 0.0
            # the last sign of life may be of the trainer before, which hung
            if HANG < silence < float("inf") and time.monotonic() - ready > HANG:
                self.trouble = f"silent for {silence:.0f} s"
                return

    def _acquaint(self) -> None:
        """Queue the introduction of a new trainer before the messages that are waiting."""
        waiting = [self._outbox.popleft() for _ in range(len(self._outbox))]
        first = self._introduce()
        # rings that waited are those of the introduction, or given up: they are closed once the trainer has the newest
        waiting = [message for message in waiting if not message.descriptors]
        self._outbox.extendleft(reversed([*first, *waiting]))
        self._ready.set()
        self._posted.set()

    def _write(self, channel: Channel, over: threading.Event) -> None:
        """Send queued messages, in a thread of its own.

        While one is being sent the trainer may be sending, too; in one thread neither side would read.
        """
        try:
            while not over.is_set():
                self._posted.wait()
                self._posted.clear()
                while self._outbox and self._ready.is_set():
                    channel.send(self._outbox.popleft())
        except ConnectionError:
            pass  # `_end` says why
        except Exception as error:
            self._tell(error)
        finally:
            channel.hang_up()  # a trainer that is told nothing more is of no use: who hears it shall notice

    def _listen(self, message: Message) -> None:
        """Pass a message to `hear`; an exception there must not end this thread."""
        try:
            self._hear(message)
        except Exception as error:
            self._tell(error)

    def _tell(self, error: Exception) -> None:
        """Store the error as `trouble`; print its traceback if it is a bug."""
        self.trouble = str(error)
        if not isinstance(error, BdnnError):
            traceback.print_exc()
            self.trouble = f"the node's side of it failed: {type(error).__name__}"

    def _end(self) -> None:
        """Reap the process, or kill it: nothing that it holds is needed any more."""
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
