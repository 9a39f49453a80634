"""The model that `model_directory` keeps: gone on from at start, saved now and then and at the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any

from bdnn_ros.bdnn.modelfile import SUFFIX
from bdnn_ros.errors import BdnnError
from bdnn_ros.models import Model
from bdnn_ros.online.places import looking_at, model_place
from bdnn_ros.online.serving import Served
from bdnn_ros.online.session import Session
from bdnn_ros.online.supervisor import PATIENCE
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

CUT_SHORT = (
    f"the trainer was still at work after {PATIENCE:g} s and was ended: the last {{}} samples are not learned"
)
PAUSED = "training is paused, it cannot go on from this kind"


class Kept:
    """The first of `model.bdnn`, `model_2.bdnn`, ... in a directory that holds a model of the robot in use.

    A file that holds none, as another arm's or a damaged one, is left as it is; so is a model of another kind than
    is saved: what is learned never takes the place of networks or of an extended model.

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
        self._forgotten = False
        self._saved: Served | None = None

    def serve(self, robot: Robot) -> None:
        """Serve this robot, and until joint states say which joints are in use, the model that is kept of all."""
        before = self._session.served
        self._session.set_robot(robot)
        if self._session.served is before:
            return
        if before is not None:
            self._logger().info("robot_description has changed: it serves anew, and learning begins again")
        if self._session.intake is None and not self._forgotten:
            self._found = self._look(early=True)

    def begin(self, joints: Sequence[str]) -> None:
        """Begin the session's stream of these joints, going on from the model that is kept of them, if there is one.

        What serves already is not replaced by it, as another model that was loaded, nor is a robot description after a reset,
        whichever joints come.
        """
        before = self._session.served
        self._session.begin(joints)
        served = self._session.served
        serves = served is before and (self._found or served.number > 0)  # type: ignore[union-attr]
        if not serves and not self._forgotten:
            self.resume()

    def reset(self) -> None:
        """Forget what was learned, and the model that is kept, which may be of joints that are still to come.

        Raises:
            UsageError: the robot is not known yet.
        """
        self._session.reset()
        self._forgotten = True

    def resume(self) -> None:
        """Serve the model that is kept, if there is one, and go on from it."""
        self._found = self._look()

    def _look(self, early: bool = False) -> bool:
        """As `resume`; says whether there is one, but early, why there is none: fewer joints may come into use."""
        refused: list[str] = []
        try:
            existing = self._existing()
        except BdnnError as error:
            self._logger().error(str(error))
            return False
        for path in existing:
            try:
                model = self._session.load_now(path)
            except Exception as error:  # whatever a file holds, it does not end the node
                refused.append(f"not going on from {path}, which is left as it is: {error}")
            else:
                self._warn(refused)
                on = isinstance(model, PhysicalModel)
                told = f"going on from {path}" if on else f"a {model.kind} model serves, {path}; {PAUSED}"
                self._logger().info(told)
                return True
        if refused and not early:
            self._warn(refused)
            self._logger().info(f"what is learned will be saved to {self._free()}")
        return False

    def _warn(self, sentences: Sequence[str]) -> None:
        for sentence in sentences:
            self._logger().warning(sentence)

    def save_meanwhile(self) -> None:
        """Keep what was learned since the last time, without waiting for the disk: who ends without an end loses no more."""
        served = self._session.served
        if served is None or not self._keeps(served) or not served.learned or served is self._saved:
            return
        model = served.model  # by the time of writing another may serve, which is not to be kept
        writing = self._session.save(lambda: self.place(model), model)
        writing.add_done_callback(partial(self._take_note, served))

    def _take_note(self, served: Served, saved: Future[Path]) -> None:
        """What was written need not be again; what was not is tried the next time."""
        if saved.cancelled():
            return
        error = saved.exception()
        if error is None:
            self._saved = served
        else:
            self._logger().error(str(error))

    def leave(self) -> None:
        """End the session, which has time to learn what came only where that is kept, and keep it."""
        session = self._session
        worth = session.stop(PATIENCE if self._directory else 0.0)
        if self._directory and session.unlearned:
            self._logger().warning(CUT_SHORT.format(session.unlearned))
        if worth:
            self.save()

    def save(self) -> None:
        """Keep what was learned at the end, or what was loaded where nothing is kept yet."""
        served = self._session.served
        assert served is not None  # only of a session that served something else than its robot
        if not self._keeps(served):
            return
        try:
            place = self.place()
            if served.learned or served.origin == str(place) or not place.exists():
                self._logger().info(f"model saved to {self._session.save_now(place)}")
        except BdnnError as error:
            self._logger().error(str(error))

    def place(self, model: Model | None = None) -> Path:
        """Where a model is saved, or the one that serves.

        Raises:
            UsageError: no directory is set, or the robot is not known yet.
        """
        self._session.known()
        if model is None:
            model = self._session.served.model  # type: ignore[union-attr]
        usable = (path for path in self._existing() if self._usable(path, model.kind))
        return next(usable, None) or self._free()

    def _keeps(self, served: Served) -> bool:
        """Whether what serves is to be kept: a model that learning cannot go on from is in the file it came from."""
        return bool(self._directory) and isinstance(served.model, PhysicalModel)

    def _existing(self) -> list[Path]:
        """The files there are, in order; one that was deleted hides none after it."""
        if not self._directory:
            return []
        first = model_place(self._directory, "")
        start = f"{first.stem}_"
        endings = [path.stem.removeprefix(start) for path in first.parent.glob(f"{start}*{SUFFIX}")]
        numbers = sorted({int(ending) for ending in endings if ending.isdecimal()} - {0, 1})
        paths = (first, *(_numbered(first, n) for n in numbers))
        with looking_at(str(first.parent)):
            return [path for path in paths if path.exists()]

    def _free(self) -> Path:
        """The first name that no file has."""
        first = model_place(self._directory, "")
        names = chain([first], (_numbered(first, n) for n in count(2)))
        return next(path for path in names if not path.exists())

    def _usable(self, path: Path, kind: str) -> bool:
        """Whether a model of this kind may take a file's place."""
        try:
            return self._session.read(path).kind == kind
        except Exception:
            return False


def _numbered(first: Path, number: int) -> Path:
    return first.with_name(f"{first.stem}_{number}{SUFFIX}")
