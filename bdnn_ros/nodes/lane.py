"""A thread beside the rclpy executor for the fast subscriptions and the services that must answer at once.

For every message, rclpy's executor collects all of the node's entities (about thirty) twice: half a millisecond of work around
a callback of thirty microseconds, and service requests wait behind it. This thread has a wait set with nothing but the joint
states, the effort commands and the dynamics services; the executor keeps the rest.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.context import Context
from rclpy.event_handler import EventHandler
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service
from rclpy.subscription import Subscription

LONGEST_WAIT = 500_000_000
"""So often the lane looks around where nothing comes [ns]."""
MOST_AT_ONCE = 20
"""Messages taken in one go when they have piled up; then it is the requests' turn again."""
EVENTS_EVERY = 0.5
"""The executor looks at events of what the lane has so often [s]."""
EVENT_LOOKS = 2
"""It asks whether to wait for an event, and again before it takes it."""
PATIENCE = 5.0
"""Longest wait for the lane to let go of something [s]."""


class Aside(MutuallyExclusiveCallbackGroup):
    """Callback group of entities that the executor skips once the lane serves them.

    Events of a subscription (lost messages) are polled now and then, and once only: the middleware signals a pending event with
    every message, over and over, until it is taken. Pending events are kept until then.
    """

    def __init__(self, lane: Lane) -> None:
        super().__init__()
        self._lane = lane
        self._looked = 0.0
        self._looks: Counter[EventHandler] = Counter()

    def can_execute(self, entity: Any) -> bool:
        """Whether the executor may handle the entity."""
        if isinstance(entity, EventHandler):
            now = time.monotonic()
            if now - self._looked > EVENTS_EVERY:
                self._looked = now
                self._looks.clear()
            self._looks[entity] += 1
            return self._looks[entity] <= EVENT_LOOKS and bool(super().can_execute(entity))
        return not self._lane.holds(entity) and bool(super().can_execute(entity))


class Lane:
    """Answers services, takes messages, and then runs a periodic chore, in a thread of its own.

    Args:
        context: of the node.

    Attributes:
        error: what ended the thread, if anything did; ROS is shut down then.
    """

    def __init__(self, context: Context) -> None:
        self.error: Exception | None = None
        self._context = context
        self._services: dict[Service, Callable[[Any, Any], Any]] = {}
        self._subscriptions: dict[Subscription, Callable[[Any, dict[str, int]], None]] = {}
        self._chore: Callable[[], None] | None = None
        self._period = self._due = 0.0
        self._wake = GuardCondition(None, None, context)
        self._changed = threading.Condition()
        self._asked = self._seen = 0
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="lane", daemon=True)
        self._thread.start()

    def group(self) -> Aside:
        """A callback group for what is handed to the lane."""
        return Aside(self)

    def holds(self, entity: Any) -> bool:
        """Whether the lane serves the entity."""
        return entity in self._services or entity in self._subscriptions

    def answer(self, service: Service, callback: Callable[[Any, Any], Any]) -> None:
        """Serve a service from now on."""
        self._services = {**self._services, service: callback}
        self._renew()

    def listen(self, subscription: Subscription, callback: Callable[[Any, dict[str, int]], None]) -> None:
        """Serve a subscription from now on; the callback gets each message with its message info."""
        self._subscriptions = {**self._subscriptions, subscription: callback}
        self._renew()

    def do(self, chore: Callable[[], None] | None, period: float = 0.0) -> None:
        """Run this after messages have come, at most once per period [s]; None for nothing any more."""
        self._period, self._chore = period, chore
        self._let_go()

    def forget(self, entity: Any) -> None:
        """Stop serving a service or subscription; returns when no callback of it is running."""
        if not self.holds(entity):
            return
        self._services = {key: value for key, value in self._services.items() if key is not entity}
        self._subscriptions = {key: value for key, value in self._subscriptions.items() if key is not entity}
        self._let_go()

    def stop(self) -> None:
        """End the thread and release all entities."""
        self._stopping = True
        self._wake.trigger()
        self._thread.join(PATIENCE)
        self._wake.destroy()

    def _renew(self) -> None:
        self._asked += 1
        self._wake.trigger()

    def _let_go(self) -> None:
        """Make the thread rebuild its wait set, and wait until it has."""
        self._renew()
        with self._changed:
            self._changed.wait_for(lambda: self._seen == self._asked or not self._thread.is_alive(), PATIENCE)

    # -- the thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._stopping and self._context.ok():
                asked = self._asked
                services, subscriptions = list(self._services.items()), list(self._subscriptions.items())
                with self._changed:
                    self._seen = asked
                    self._changed.notify_all()
                with ExitStack() as held:
                    for entity, _ in (*services, *subscriptions):
                        held.enter_context(entity.handle)
                    held.enter_context(self._wake.handle)
                    held.enter_context(self._context.handle)
                    self._serve(asked, services, subscriptions)
        except Exception as error:
            if self._context.ok():  # else it is the end anyway; the executor would end the node, too
                traceback.print_exc()
                self.error = error
                self._context.try_shutdown()
        finally:
            with self._changed:
                self._seen = self._asked
                self._changed.notify_all()

    def _serve(
        self,
        asked: int,
        services: list[tuple[Service, Callable[[Any, Any], Any]]],
        subscriptions: list[tuple[Subscription, Callable[[Any, dict[str, int]], None]]],
    ) -> None:
        """Serve these entities until the set of entities changes."""
        ready = rclpy_implementation.WaitSet(
            len(subscriptions), 1, 0, 0, len(services), 0, self._context.handle
        )
        while self._asked == asked and not self._stopping and self._context.ok():
            ready.clear_entities()
            for subscription, _ in subscriptions:
                ready.add_subscription(subscription.handle)
            for service, _ in services:
                ready.add_service(service.handle)
            ready.add_guard_condition(self._wake.handle)
            ready.wait(LONGEST_WAIT)
            for index, (service, callback) in enumerate(services):
                if ready.is_ready("service", index):
                    _answer(service, callback)
            for index, (subscription, take) in enumerate(subscriptions):
                if ready.is_ready("subscription", index):
                    _take(subscription, take)
                    self._do_chore()

    def _do_chore(self) -> None:
        chore, now = self._chore, time.monotonic()
        if chore is not None and now >= self._due:
            self._due = max(self._due + self._period, now)
            chore()


def _answer(service: Service, callback: Callable[[Any, Any], Any]) -> None:
    """Answer one request, if there is one."""
    request, header = service.handle.service_take_request(service.srv_type.Request)
    if header is not None:
        service.send_response(callback(request, service.srv_type.Response()), header)


def _take(subscription: Subscription, callback: Callable[[Any, dict[str, int]], None]) -> None:
    """Take the messages that are waiting, a few at a time."""
    for _ in range(MOST_AT_ONCE):
        taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        callback(*taken)
