"""What the trainer was asked, and who waits for the answers."""

from __future__ import annotations

from concurrent.futures import Future

from bdnn_ros.online.channel import Message


class Requests:
    """Questions by number; each is answered once, or fails."""

    def __init__(self) -> None:
        self._waiting: dict[int, Future[Message]] = {}
        self._number = 0

    def new(self) -> tuple[int, Future[Message]]:
        """Number of a new question, and its answer."""
        self._number += 1
        future = self._waiting[self._number] = Future()
        return self._number, future

    def answer(self, message: Message) -> None:
        """Hand a message over to who asked for it, if anybody did."""
        future = self._waiting.pop(int(message.info.get("request") or 0), None)
        if future is not None:
            future.set_result(message)

    def fail(self, error: Exception) -> None:
        """Nobody will answer what was asked so far."""
        for number in list(self._waiting):
            self._waiting.pop(number).set_exception(error)

    def cancel(self) -> None:
        """Nobody waits any more."""
        for future in self._waiting.values():
            future.cancel()
