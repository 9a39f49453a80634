"""`bdnn VERB ...`: runs the verb and turns every error into one sentence and an exit status."""

from __future__ import annotations

import argparse
import errno
import io
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from types import FrameType
from typing import NoReturn

from bdnn_ros.errors import BdnnError, DataError, UsageError, listed

VERBS = {
    "demo": "simulate a worn robot with a hidden effect, identify it, diagnose it, and reveal the truth",
    "simulate": "record a simulated robot with chosen or hidden effects",
    "info": "say what a bag holds and whether it is fit for identification",
    "identify": "identify a model from recordings",
    "diagnose": "name what the simulation gets wrong, with the gain of mending it",
    "predict": "predict the effort along a recording, as CSV",
    "evaluate": "score a model on a recording",
    "export": "write a model as URDF, MuJoCo model, YAML and ONNX",
    "excite": "make the motion that tells the rivals of a diagnosis apart",
    "replay": "run the online identifier over a bag and show its error against time",
}
"""What `bdnn --help` says of each verb, whose module is imported only when it is called."""
USAGE_STATUS = 2
BROKE_DOWN = (
    "The computation broke down on these numbers: check the recording with bdnn info, and the description"
)
SIGNALLED_STATUS = 128
"""And the signal's number on top."""
INTERRUPTED_STATUS = SIGNALLED_STATUS + signal.SIGINT
BROKEN_PIPE_STATUS = 141
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end the work, with nothing half-written left."""
UNMINDED = (signal.SIG_DFL, signal.default_int_handler)
"""What Python does at a signal that nobody minds."""
PATIENCE = 5.0
"""So long [s] after a signal Ctrl-C does nothing while what is half-written is cleared away; later it ends that, too."""


class Ended(KeyboardInterrupt):
    """A signal has asked to stop.

    Args:
        number: the signal's.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError`."""

    def error(self, message: str) -> NoReturn:
        """Raises `UsageError`."""
        raise UsageError(f"{message[:1].upper()}{message[1:].rstrip('.')}.", f"See {self.prog} --help.")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit status: 0 done, 1 the data cannot answer, 2 wrong usage."""
    words = list(sys.argv[1:] if argv is None else argv)
    _open_closed_streams()
    _print_anything()
    try:
        with _signals():
            status = _run(words)
            sys.stdout.flush()
        return status
    except BdnnError as error:
        return _complain(str(error), error.exit_status)
    except Ended as end:
        return SIGNALLED_STATUS + end.number
    except KeyboardInterrupt:
        return INTERRUPTED_STATUS
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains at exit
        return BROKEN_PIPE_STATUS
    except ValueError as error:
        from numpy.linalg import LinAlgError  # no verb has failed in it without having loaded numpy

        if not isinstance(error, LinAlgError):
            raise
        return _complain(f"{BROKE_DOWN} ({error}).", DataError.exit_status)
    except OSError as error:
        return _complain(_of_a_file(error), USAGE_STATUS)


@contextmanager
def _signals() -> Iterator[None]:
    """Raise `Ended` when a signal of `ENDING` arrives, unless it is ignored (as under nohup)."""
    main_thread = threading.current_thread() is threading.main_thread()
    before = {number: signal.getsignal(number) for number in ENDING if main_thread}
    minded = [number for number, handler in before.items() if handler in UNMINDED]
    first = 0.0

    def end(number: int, frame: FrameType | None) -> None:
        nonlocal first
        if first and (number != signal.SIGINT or time.monotonic() < first + PATIENCE):
            return  # a second one must not leave half a result
        first = time.monotonic()
        raise Ended(number)

    for number in minded:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in minded:
            signal.signal(number, before[number])


def _open_closed_streams() -> None:
    """Replace standard streams that the caller has closed by /dev/null, here and for child processes.

    Otherwise Python sets them to None, and the next file that is opened would take their place.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(nowhere, True)
            setattr(sys, name, os.fdopen(nowhere, mode, encoding="utf-8"))


def _print_anything() -> None:
    """Print characters that the terminal or pipe cannot encode as escapes instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _run(words: list[str]) -> int:
    if not words:
        print(f"{_help()}\n", file=sys.stderr)
        raise UsageError("No verb is given.", "See bdnn --help.")
    if words[0] in ("-h", "--help"):
        print(_help())
        return 0
    verb, *rest = words
    if verb not in VERBS:
        raise UsageError(f"There is no verb {verb!r}; there are {listed(VERBS, 20)}.", "See bdnn --help.")
    module = import_module(f"bdnn_ros.cli.{verb}")
    parser = Parser(prog=f"bdnn {verb}", description=f"{VERBS[verb][:1].upper()}{VERBS[verb][1:]}.")
    module.add_arguments(parser)
    try:
        args = parser.parse_args(rest)
    except SystemExit as stop:  # --help
        return int(stop.code or 0)
    from bdnn_ros.bags import copies_kept  # every verb has loaded it

    with copies_kept():
        return int(module.run(args))


def _help() -> str:
    width = max(map(len, VERBS)) + 2
    verbs = "\n".join(f"  {verb:{width}}{text}" for verb, text in VERBS.items())
    about = "Learns a robot's dynamics from its motion and names what its simulation gets wrong."
    return f"usage: bdnn VERB ...\n\n{about}\n\n{verbs}\n\nbdnn VERB --help says more."


def _of_a_file(error: OSError) -> str:
    """The message for a file error that nothing else has handled, such as a full disk behind stdout."""
    remedy = " Make room on its disk." if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
    where = error.filename or "the standard output or a temporary file"
    return f"{error.strerror or error}: {where}.{remedy}"


def _complain(sentence: str, status: int) -> int:
    print(f"bdnn: error: {' '.join(sentence.split())}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
