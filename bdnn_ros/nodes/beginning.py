"""Start-up and shutdown that all nodes share, and what happens to exceptions in their callbacks."""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node

from bdnn_ros.errors import BdnnError, UsageError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
AnyNode = TypeVar("AnyNode", bound=Node)
ERROR_PERIOD = 60.0
"""An error that comes again and again is logged once in so long [s]."""


def begin(arguments: list[str] | None) -> None:
    """Initialise ROS with these arguments, or with those of the command line where they are None.

    SIGTERM and the hang-up of the terminal (SIGHUP) interrupt the node like Ctrl-C.

    Raises:
        UsageError: what follows --ros-args cannot be understood.
    """
    # ROS's own handler calls the one from before: without, it is heard only where somebody asks ROS
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    set_logger_level("rcl", LoggingSeverity.FATAL)  # it would say the same in another line
    try:
        rclpy.init(args=arguments)
    except RuntimeError as error:  # of rclpy's binding, which names no more of them
        reason = str(error).removeprefix("failed to initialize rcl: ").partition(", at /")[0].rstrip(".")
        reason = f"unknown arguments {reason}" if reason.startswith("[") else reason
        raise UsageError(
            f"ROS cannot start: {reason}.", "Pass parameters as --ros-args -p NAME:=VALUE."
        ) from None
    set_logger_level("rcl", LoggingSeverity.UNSET)
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # else nohup wants the node to go on
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))


def undisturbed() -> None:
    """Ignore further signals, so that a second Ctrl-C does not interrupt the shutdown."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def end() -> None:
    """Shut ROS down; does nothing if its own signal handler is doing so at the same time."""
    with suppress(RuntimeError):  # of rclpy's binding, where both found it running and the other was first
        rclpy.try_shutdown()


def run(
    name: str,
    arguments: list[str] | None,
    make: Callable[[], AnyNode],
    work: Callable[[AnyNode], int],
    finish: Callable[[AnyNode], int] = lambda node: 0,
    worded: Callable[[BdnnError], str] = str,
) -> int:
    """Start ROS, make a node, let it work and shut everything down; returns the exit status.

    Args:
        work, finish: return an exit status; `finish` is called also after an error or Ctrl-C.
        worded: the message for an error of this package.
    """
    node = None
    status = 0
    try:
        begin(arguments)
        node = make()
        status = work(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except BdnnError as error:
        print(f"{name}: error: {worded(error)}", file=sys.stderr)
        status = error.exit_status
    except Exception:
        if rclpy.ok():  # else a signal came while a call to ROS was under way: that is the end, too
            raise
    finally:
        undisturbed()
        if node is not None:
            ended = finish(node)
            status = status or ended
            node.destroy_node()
        end()
    return status


def told(transition: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a lifecycle transition to print the traceback of an exception, which rclpy swallows."""

    @wraps(transition)
    def telling(*arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        try:
            return transition(*arguments, **named)
        except Exception:
            traceback.print_exc()
            raise

    return telling


def outlived(
    method: Callable[Concatenate[AnyNode, Arguments], None],
) -> Callable[Concatenate[AnyNode, Arguments], None]:
    """Decorate a callback of a node so that an exception in it is logged and does not end the node, as long as ROS runs."""

    @wraps(method)
    def outliving(node: AnyNode, *arguments: Arguments.args, **named: Arguments.kwargs) -> None:
        try:
            method(node, *arguments, **named)
        except Exception:
            if not node.context.ok():
                raise  # at the end of ROS any call to it fails
            node.get_logger().error(traceback.format_exc(), throttle_duration_sec=ERROR_PERIOD)

    return outliving
