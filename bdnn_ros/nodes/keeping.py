"""The model that `model_directory` keeps: gone on from at start, saved now and then and at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from itertools import count
from pathlib import Path
from typing import Any

from bdnn_ros.bdnn.modelfile import SUFFIX
from bdnn_ros.errors import BdnnError
from bdnn_ros.online.places import model_place
from bdnn_ros.online.session import Session
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

PAUSED = "training is paused, it cannot go on from this kind"


class Kept:
    """The first of `model.bdnn`, `model_2.bdnn`, ... in a directory that holds a model of the robot in use.

    A file that holds none, as another arm's or a damaged one, is left as it is.

    Args:
        directory: where; empty keeps none.
        session: what learns the model.
        logger: gives the logger.
    """

    def __init__(self, directory: str, session: Session, logger: Callable[[], Any]) -> None:
        self._directory = directory
        self._session = session
        self._logger = logger
        self._found = False
        self._saved = 0

    def serve(self, robot: Robot) -> None:
        """Serve this robot, and until joint states say which joints are in use, the model that is kept of all."""
        before = self._session.served
        self._session.set_robot(robot)
        if self._session.served is before:
            return
        if before is not None:
            self._logger().info("robot_description has changed: it serves anew, and learning begins again")
        if self._session.intake is None:
            self._found = self._look(early=True)

    def begin(self, joints: Sequence[str]) -> None:
        """Begin the session's stream of these joints, going on from the model that is kept of them, if there is one.

        What serves already is not replaced: another model that was loaded, or the robot description after a reset.
        """
        before = self._session.served
        self._session.begin(joints)
        served = self._session.served
        if served is not before or not (self._found or served.number):  # type: ignore[union-attr]
            self.resume()

    def resume(self) -> None:
        """Serve the model that is kept, if there is one, and go on from it."""
        self._found = self._look()

    def _look(self, early: bool = False) -> bool:
        """As `resume`; says whether there is one, but early, why there is none: fewer joints may come into use."""
        refused: list[str] = []
        for path in self._places() if self._directory else ():
            if not path.exists():
                break
            try:
                model = self._session.load_now(path)
            except BdnnError as error:
                refused.append(f"not going on from {path}, which is left as it is: {error}")
            else:
                self._warn(refused)
                on = isinstance(model, PhysicalModel)
                told = f"going on from {path}" if on else f"a {model.kind} model serves, {path}; {PAUSED}"
                self._logger().info(told)
                return True
        if refused and not early:
            self._warn(refused)
            self._logger().info(f"what is learned will be saved to {path}")
        return False

    def _warn(self, sentences: Sequence[str]) -> None:
        for sentence in sentences:
            self._logger().warning(sentence)

    def save_meanwhile(self) -> None:
        """Keep what was learned since the last time, without waiting for the disk: who ends without an end loses no more."""
        served = self._session.served
        if not self._keeps() or served is None or served.number in (0, self._saved):
            return
        self._saved = served.number
        self._session.save(self.place).add_done_callback(self._tell_failure)

    def _tell_failure(self, saved: Future[Path]) -> None:
        error = None if saved.cancelled() else saved.exception()
        if error is not None:
            self._logger().error(str(error))

    def save(self) -> None:
        """Keep what was learned at the end."""
        if not self._keeps():
            return
        try:
            self._logger().info(f"model saved to {self._session.save_now(self.place())}")
        except BdnnError as error:
            self._logger().error(str(error))

    def place(self) -> Path:
        """Where the model that serves is saved.

        Raises:
            UsageError: no directory is set, or the robot is not known yet.
        """
        self._session.known()
        return next(path for path in self._places() if not path.exists() or self._usable(path))

    def _keeps(self) -> bool:
        """Whether what serves is to be kept: a model that learning cannot go on from is in the file it came from."""
        served = self._session.served
        return bool(self._directory) and (served is None or isinstance(served.model, PhysicalModel))

    def _places(self) -> Iterator[Path]:
        first = model_place(self._directory, "")
        yield first
        for number in count(2):
            yield first.with_name(f"{first.stem}_{number}{SUFFIX}")

    def _usable(self, path: Path) -> bool:
        try:
            self._session.read(path)
        except BdnnError:
            return False
        return True
