"""Pending requests to the trainer."""

from __future__ import annotations

from concurrent.futures import Future

from bdnn_ros.online.channel import Message


class Requests:
    """Requests by number; each is answered once, or fails."""

    def __init__(self) -> None:
        self._waiting: dict[int, Future[Message]] = {}
        self._number = 0

    def new(self) -> tuple[int, Future[Message]]:
        """The number of a new request, and the future of its answer."""
        self._number += 1
        future = self._waiting[self._number] = Future()
        return self._number, future

    def answer(self, message: Message) -> None:
        """Pass an answer on to its request, if one is waiting."""
        future = self._waiting.pop(int(message.info.get("request") or 0), None)
        if future is not None:
            future.set_result(message)

    def fail(self, error: Exception) -> None:
        """Fail all pending requests."""
        for number in list(self._waiting):
            self._waiting.pop(number).set_exception(error)

    def cancel(self) -> None:
        """Cancel all pending requests."""
        for future in self._waiting.values():
            future.cancel()
