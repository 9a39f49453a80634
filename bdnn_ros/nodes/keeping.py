"""The model in `model_directory`: resumed at start, saved periodically and at shutdown."""

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
    """The saved model: the first of `model.bdnn`, `model_2.bdnn`, ... that is a model of the robot in use.

    Files that are not (another arm's, a damaged one, or a model of a kind that is not learned live) are never overwritten: a new
    name is chosen.

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
        """Serve this robot; until joint states show which joints are in use, with the saved model of all its joints."""
        before = self._session.served
        self._session.set_robot(robot)
        if self._session.served is before:
            return
        if before is not None:
            self._logger().info("robot_description has changed: it serves anew, and learning begins again")
        if self._session.intake is None and not self._forgotten:
            self._found = self._look(early=True)

    def begin(self, joints: Sequence[str]) -> None:
        """Begin the session's stream of these joints and continue from the saved model of them, if there is one.

        The saved model does not replace a model that was loaded by service, nor the robot description after a reset.
        """
        before = self._session.served
        self._session.begin(joints)
        served = self._session.served
        serves = served is before and (self._found or served.number > 0)  # type: ignore[union-attr]
        if not serves and not self._forgotten:
            self.resume()

    def reset(self) -> None:
        """Forget what was learned, and do not resume the saved model later, when further joints come into use.

        Raises:
            UsageError: the robot is not known yet.
        """
        self._session.reset()
        self._forgotten = True

    def resume(self) -> None:
        """Serve the saved model, if there is one, and continue learning from it."""
        self._found = self._look()

    def _look(self, early: bool = False) -> bool:
        """As `resume`; returns whether there is such a model.

        Args:
            early: further joints may still come into use, so it is not logged why there is none.
        """
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
        """Save what was learned since the last save without waiting for the disk, so that a killed node loses little."""
        served = self._session.served
        if served is None or not self._keeps(served) or not served.learned or served is self._saved:
            return
        model = served.model  # by the time of writing another may serve, which is not to be kept
        writing = self._session.save(lambda: self.place(model), model)
        writing.add_done_callback(partial(self._take_note, served))

    def _take_note(self, served: Served, saved: Future[Path]) -> None:
        """Remember which version was written; a failed save is tried again the next time."""
        if saved.cancelled():
            return
        error = saved.exception()
        if error is None:
            self._saved = served
        else:
            self._logger().error(str(error))

    def leave(self) -> None:
        """End the session and save. The trainer gets time to learn the rest only if the result is saved."""
        session = self._session
        worth = session.stop(PATIENCE if self._directory else 0.0)
        if self._directory and session.unlearned:
            self._logger().warning(CUT_SHORT.format(session.unlearned))
        if worth:
            self.save()

    def save(self) -> None:
        """Save at shutdown what was learned, or what was loaded if nothing is saved yet."""
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
        """The file to save a model to; by default for the model in service.

        Raises:
            UsageError: no directory is set, or the robot is not known yet.
        """
        self._session.known()
        if model is None:
            model = self._session.served.model  # type: ignore[union-attr]
        usable = (path for path in self._existing() if self._usable(path, model.kind))
        return next(usable, None) or self._free()

    def _keeps(self, served: Served) -> bool:
        """Whether the model in service is to be saved: one that learning cannot continue from is in its own file already."""
        return bool(self._directory) and isinstance(served.model, PhysicalModel)

    def _existing(self) -> list[Path]:
        """The model files that exist, in order; a deleted number does not hide later ones."""
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
        """The first file name that is not taken."""
        first = model_place(self._directory, "")
        names = chain([first], (_numbered(first, n) for n in count(2)))
        return next(path for path in names if not path.exists())

    def _usable(self, path: Path, kind: str) -> bool:
        """Whether a model of this kind may overwrite the file."""
        try:
            return self._session.read(path).kind == kind
        except Exception:
            return False


def _numbered(first: Path, number: int) -> Path:
    return first.with_name(f"{first.stem}_{number}{SUFFIX}")
