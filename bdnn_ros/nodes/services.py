"""The services of the identification node. An invalid request is refused with a message, never with an exception."""

from __future__ import annotations

import traceback
import types
from collections.abc import Awaitable, Callable, Generator, Iterator
from concurrent.futures import Future as Later
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar

import numpy as np
from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from bdnn_interfaces.srv import Diagnose, ForwardDynamics, InverseDynamics, LoadModel, SaveModel
from bdnn_ros.diagnosis.recorded.excerpts import refuse_window
from bdnn_ros.errors import BdnnError, UsageError, article
from bdnn_ros.nodes.conversions import findings_message, numbers, requested
from bdnn_ros.nodes.keeping import PAUSED, Kept
from bdnn_ros.nodes.lane import Lane
from bdnn_ros.online.places import model_place, model_to_load
from bdnn_ros.online.serving import Served
from bdnn_ros.online.session import Session

Result = TypeVar("Result")
CLEANED_UP = UsageError("The node is being cleaned up.", "Ask again when it is configured.")
BEYOND = UsageError("The answer is not finite.", "Ask for values that a robot can have.")
FILES = "Check what model_directory holds, and its permissions."
UNFORESEEN = "The node goes on, and its log says where; please report it."


class Services:
    """The services of the node; `close` destroys them.

    Args:
        node: to create them on.
        lane: answers the questions about dynamics.
        session: what they are about.
        directory: gives the model directory.
        kept: the model in it that has no name.
        training_set: called after training was switched on or off.
        forgotten: called after what was learned was forgotten.
    """

    def __init__(
        self,
        node: Node,
        lane: Lane,
        session: Session,
        directory: Callable[[], str],
        kept: Kept,
        training_set: Callable[[bool], None],
        forgotten: Callable[[], None],
    ) -> None:
        self._node = node
        self._lane = lane
        self._session = session
        self._directory = directory
        self._kept = kept
        self._training_set = training_set
        self._forgotten = forgotten
        self._asked: set[Future] = set()
        self._closed = False
        self._services = [
            self._at_once(InverseDynamics, "~/inverse_dynamics", self._inverse_dynamics),
            self._at_once(ForwardDynamics, "~/forward_dynamics", self._forward_dynamics),
            node.create_service(Trigger, "~/reset", self._refusing(self._reset)),
            node.create_service(SetBool, "~/set_training", self._refusing(self._set_training)),
        ]
        # others go on meanwhile
        beside = ReentrantCallbackGroup()
        self._patient = [
            self._in_time(Diagnose, "~/diagnose", self._diagnose, beside),
            self._in_time(SaveModel, "~/save_model", self._save, beside),
            self._in_time(LoadModel, "~/load_model", self._load, beside),
        ]

    def close(self) -> None:
        """Destroy the services; requests that are still waiting are refused."""
        for service in self._services:
            self._lane.forget(service)
            self._node.destroy_service(service)
        self._services.clear()
        self._closed = True
        asked, executor = list(self._asked), self._node.executor
        for future in asked:
            if not future.done():
                future.set_exception(CLEANED_UP)
        if executor is None:
            self._asked.clear()  # nobody would send the refusals
        elif asked:  # the refusals are sent by tasks of the executor
            executor.create_task(self._withdraw_after(executor))
        self.withdraw()

    async def _withdraw_after(self, executor: Executor) -> None:
        while self._asked:
            executor.wake()  # else it would wait for an event before the next turn
            await _turn()
        self.withdraw()

    def withdraw(self) -> None:
        """After `close`: destroy the services whose pending refusals had to be sent first."""
        if not self._asked:
            for service in self._patient:
                self._node.destroy_service(service)
            self._patient.clear()

    def _at_once(self, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> Any:
        """A service in the lane: it does not wait for the executor."""
        answer = self._refusing(callback)
        service = self._node.create_service(kind, name, answer, callback_group=self._lane.group())
        self._lane.answer(service, answer)
        return service

    def _in_time(
        self, kind: Any, name: str, callback: Callable[[Any, Any], Awaitable[Any]], group: CallbackGroup
    ) -> Any:
        """A service whose answer waits for the disk or the trainer; refuses requests once the session has ended."""

        async def answer(request: Any, response: Any) -> Any:
            try:
                if self._closed:
                    raise CLEANED_UP
                return await callback(request, response)
            except Exception as error:
                return self._refused(response, error)

        return self._node.create_service(kind, name, answer, callback_group=group)

    def _refusing(self, callback: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """The callback with its exceptions turned into refusals."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                return self._refused(response, error)

        return answer

    def _refused(self, response: Any, error: Exception) -> Any:
        """The response to a request whose callback raised: no request may end the node."""
        if isinstance(error, OSError):
            where = error.filename or "A file in model_directory"
            error = UsageError(f"{where} cannot be used ({error.strerror or error}).", FILES)
        elif not isinstance(error, BdnnError):
            if not self._node.context.ok():
                raise error  # at the end of ROS any call to it fails
            self._node.get_logger().error("".join(traceback.format_exception(error)))
            error = UsageError(f"The request failed ({type(error).__name__}: {error}).", UNFORESEEN)
        refusal = type(response)()  # nothing of an answer that was begun
        refusal.success, refusal.message = False, str(error)
        return refusal

    # -- dynamics --------------------------------------------------------------------------------

    def _served(self) -> Served:
        served = self._session.served
        if served is None:
            raise UsageError("The robot is not known yet.", "Publish robot_description, or set urdf_file.")
        return served

    def _inverse_dynamics(
        self, request: InverseDynamics.Request, response: InverseDynamics.Response
    ) -> InverseDynamics.Response:
        served = self._served()
        fields = {name: getattr(request, name) for name in ("position", "velocity", "acceleration")}
        index, motion = requested(served.joints, request.joint_names, fields)
        with _computing():
            told = served.parts(motion["position"], motion["velocity"], motion["acceleration"])
        if not np.isfinite(told.effort).all():
            raise BEYOND
        response.joint_names = [served.joints[k] for k in index]
        response.effort = numbers(told.effort[index])
        response.effort_std = numbers(told.std[index]) if len(told.std) else []
        response.mass_matrix = numbers(told.mass_matrix[index][:, index])
        response.coriolis = numbers(told.coriolis[index])
        response.gravity = numbers(told.gravity[index])
        response.friction = numbers((told.friction + told.learned)[index])
        response.model_version = served.number
        return _done(response)

    def _forward_dynamics(
        self, request: ForwardDynamics.Request, response: ForwardDynamics.Response
    ) -> ForwardDynamics.Response:
        served = self._served()
        fields = {name: getattr(request, name) for name in ("position", "velocity", "effort")}
        index, motion = requested(served.joints, request.joint_names, fields)
        with _computing():
            acceleration = served.forward_dynamics(motion["position"], motion["velocity"], motion["effort"])
        if not np.isfinite(acceleration).all():
            raise BEYOND
        response.joint_names = [served.joints[k] for k in index]
        response.acceleration = numbers(acceleration[index])
        response.model_version = served.number
        return _done(response)

    # -- learning --------------------------------------------------------------------------------

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._kept.reset()
        self._forgotten()
        return _done(response, "What was learned is forgotten; the robot description serves.")

    def _set_training(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._session.set_training(request.data)
        self._training_set(request.data)
        told = "Training goes on." if request.data else "Training is paused."
        if request.data and not self._session.learning:
            told = "Training goes on with the next model that it can go on from: load one, or reset."
        return _done(response, told)

    async def _diagnose(self, request: Diagnose.Request, response: Diagnose.Response) -> Diagnose.Response:
        if not 0.0 <= request.window < float("inf"):
            raise UsageError(f"window is {request.window:g}; it must be zero or more seconds.")
        refuse_window(request.window)
        answer = await self._until(self._session.diagnose(request.window))
        if "error" in answer.info:
            response.success, response.message = False, str(answer.info["error"])
            return response
        now = self._node.get_clock().now().to_msg()
        diagnosis = answer.info["diagnosis"]
        response.findings = findings_message(diagnosis, now)
        return _done(response, ". ".join(filter(None, (diagnosis["verdict"], " ".join(diagnosis["notes"])))))

    # -- files -----------------------------------------------------------------------------------

    async def _save(self, request: SaveModel.Request, response: SaveModel.Response) -> SaveModel.Response:
        directory = self._directory()
        place = partial(model_place, directory, request.name) if request.name else self._kept.place
        path = await self._until(self._session.save(place))
        return _done(response, f"Saved to {path}.")

    async def _load(self, request: LoadModel.Request, response: LoadModel.Response) -> LoadModel.Response:
        model = await self._until(self._session.load(model_to_load(self._directory(), request.name)))
        note = "training goes on from it"
        if not self._session.training:
            note = "training is switched off"
        elif not self._session.learning:
            note = PAUSED
        return _done(response, f"{article(model.kind).capitalize()} model serves; {note}.")

    async def _until(self, later: Later[Result]) -> Result:
        """Wait for a thread's result without holding up the executor."""
        executor = self._node.executor
        future: Future = Future(executor=executor)
        self._asked.add(future)

        def settle(done: Later[Result]) -> None:
            if future.done():  # refused meanwhile
                return
            error = None if done.cancelled() else done.exception()
            if done.cancelled():
                future.set_exception(UsageError("The node is shutting down."))
            elif error is not None:
                future.set_exception(error)
            else:
                future.set_result(done.result())
            if executor is not None:
                executor.wake()

        later.add_done_callback(settle)
        try:
            result: Result = await future
        finally:
            self._asked.discard(future)
        return result


@contextmanager
def _computing() -> Iterator[None]:
    """Turn floating-point overflow into a refusal: arrays overflow to infinity, Python floats raise."""
    try:
        with np.errstate(all="ignore"):
            yield
    except np.linalg.LinAlgError:
        raise UsageError("The mass matrix is singular in this position.") from None
    except (ArithmeticError, ValueError):
        raise BEYOND from None


@types.coroutine
def _turn() -> Generator[None, None, None]:
    """Yield to the other tasks of the executor once."""
    yield


def _done(response: Any, message: str = "") -> Any:
    response.success, response.message = True, message
    return response
