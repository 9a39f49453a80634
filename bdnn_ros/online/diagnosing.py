"""The process that makes one diagnosis: it receives the robot and the recording, answers, and ends.

Started by `analysis.Analyst` as `python -m bdnn_ros.online.diagnosing`. A diagnosis takes up to a gigabyte of memory for half a
minute, which a long-lived process would not return completely.
"""

from __future__ import annotations

import argparse
import os
import socket
import sys
import threading
import traceback
from typing import Any

from bdnn_ros.errors import BdnnError, ConventionError
from bdnn_ros.online.channel import Channel, Message, leave_signals_to_the_node
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

NICENESS = 9
"""How much more than the trainer it yields to other processes."""


def question(recording: Recording, robot: Robot, cutoff: float | None) -> Message:
    """The message that asks for a diagnosis; the recording must have effort."""
    arrays = {"time": recording.time, "position": recording.position, "effort": recording.require_effort()}
    if recording.velocity is not None:
        arrays["velocity"] = recording.velocity
    info = {
        "urdf": robot.urdf,
        "joints": list(robot.joints),
        "name": recording.name,
        "notes": list(recording.notes),
        "cutoff": cutoff,
    }
    return Message("diagnose", info, arrays)


def answer(message: Message) -> Message:
    """The diagnosis or the reason why there is none, and whether the stream and the description match."""
    try:
        return Message("answer", {"diagnosis": _diagnosis(message), "unlike": False})
    except BdnnError as error:
        return Message("answer", {"error": str(error), "unlike": isinstance(error, ConventionError)})
    except Exception as error:  # whatever it is, who asked must hear of it
        traceback.print_exc(file=sys.stderr)
        return Message("answer", {"error": f"The diagnosis failed ({type(error).__name__})."})


def _diagnosis(message: Message) -> dict[str, Any]:
    from bdnn_ros.diagnosis.diagnose import diagnose  # slow to import: the question is on its way meanwhile

    info, arrays = message.info, message.arrays
    robot = Robot.from_urdf(info["urdf"], info["joints"])
    columns = arrays["position"], arrays.get("velocity"), arrays["effort"]
    notes = tuple(info["notes"])
    recording = Recording(arrays["time"], robot.joints, *columns, name=info["name"], notes=notes)
    return diagnose([recording], robot, cutoff=info["cutoff"]).as_json()


def _end_with(channel: Channel) -> None:
    """End the process when the channel closes: nobody waits for the answer any more."""
    try:
        channel.receive()
    except ConnectionError:
        os._exit(0)


def main(arguments: list[str] | None = None) -> int:
    """Entry point of the process."""
    parser = argparse.ArgumentParser(description="One diagnosis for a trainer; started by it.")
    parser.add_argument("--channel", type=int, required=True, help="descriptor of the socket to the trainer")
    options = parser.parse_args(arguments)
    leave_signals_to_the_node()
    os.nice(NICENESS)
    channel = Channel(socket.socket(fileno=options.channel))
    try:
        message = channel.receive()
        threading.Thread(target=_end_with, args=(channel,), name="watch", daemon=True).start()
        channel.send(answer(message))
    except ConnectionError:
        pass  # the trainer is gone
    return 0


if __name__ == "__main__":
    sys.exit(main())
