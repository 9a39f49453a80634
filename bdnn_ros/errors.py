"""The errors of the package; each says in one sentence what is wrong, and in another what to do."""

from __future__ import annotations


class BdnnError(Exception):
    """A problem the user can act on: one sentence, and what to do about it.

    Args:
        problem: what is wrong, one sentence.
        remedy: what the user can do, one sentence (may be empty).
    """

    exit_status = 1

    def __init__(self, problem: str, remedy: str = "") -> None:
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{problem} {remedy}".strip())


class UsageError(BdnnError):
    """The command or the call was wrong: unknown name, option out of range, file that is not there."""

    exit_status = 2


class DataError(BdnnError):
    """The data cannot answer what was asked."""


class BagError(DataError):
    """A bag cannot be read: empty, truncated, not a bag, or without the messages that are needed."""


class RecordingError(DataError):
    """A recording is unusable: no effort, NaN, stamps that go backwards, too short, no motion."""


class ConventionError(RecordingError):
    """A recording and its robot's description do not go together: units, signs, zeros, axes, base or gravity differ."""


class RobotError(UsageError):
    """A robot description cannot be used: it does not parse, or it lacks the joints asked for."""


class ModelFileError(UsageError):
    """A model file cannot be used: missing, damaged, or of another format or version."""


class UpdateRejected(DataError):
    """An update of a model failed its checks (non-finite, M not positive-definite, worse on held-out data)."""


def unwritable(path: object, error: OSError) -> UsageError:
    """What to say where something cannot be written: the place, the reason and what to do."""
    return UsageError(
        f"{path} cannot be written ({error.strerror or error}).",
        "Make room and check permissions there, or name another place.",
    )


def listed(names: object, most: int = 8) -> str:
    """Names for a message, `a, b, c ...`, cut after `most`."""
    every = [str(name) for name in names]  # type: ignore[attr-defined]
    return ", ".join(every[:most]) + (f" ... ({len(every)} in all)" if len(every) > most else "")


def article(noun: str) -> str:
    """A noun, or what stands before one, with its article: `an extended`."""
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"
