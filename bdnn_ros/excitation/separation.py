"""How well a planned motion would distinguish causes.

The expected evidence of a finding against its rival is half the squared norm of the finding's effort after the rival, the
other findings and link errors have explained what they can: the criterion of T-optimal design (Atkinson, Fedorov, The design
of experiments for discriminating between two rival models, Biometrika 62(1), 1975). It follows from Gram matrices, which add
up over pieces of motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.judging.identifiability import same_physics
from bdnn_ros.diagnosis.judging.lookalikes import looked_for
from bdnn_ros.diagnosis.regression.term import COMMON
from bdnn_ros.diagnosis.telling.naming import name_of
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import get
from bdnn_ros.effects.rigid import slots as of_body
from bdnn_ros.excitation.motions import Piece
from bdnn_ros.excitation.rivals import Case, Question, Suspect
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

RATE = 50.0
"""Samples a second at which motions are looked at [Hz]."""
CUTOFF = 10.0
"""Low-pass that a recording of the motion will pass [Hz]."""
THINNING = 2
"""One sample in so many carries independent noise."""
LINK_ERROR = 0.06
"""How far the links may be off: what an error of theirs can explain tells nothing."""
STAMP_ERROR = 1e-3
"""How far the effort's stamps may be off [s]."""
MOST_SHAPES = 4
"""A rival whose shape is not known is granted so many of them at once."""
TIMED = frozenset({"external_wrench", "drift"})
"""What is there only for a time is told by repeating a motion, not by another one."""
SMALL = 1e-3
"""Evidence that counts as none [nats]."""
PLENTY = 100.0
"""Evidence beyond which more is of little use [nats]."""
BALANCE = 0.3
"""How much all parameters count beside the questions: a diagnosis of the motion needs them as well."""


@dataclass(frozen=True)
class Pair:
    """A finding and one rival, as columns of the design: whose effort is to remain after which explanation.

    If the rival contains the finding (Stribeck friction contains Coulomb friction), it would explain all of it. Then the
    rival's own columns are to remain after the finding's, each scaled to the finding's peak.

    Attributes:
        finding, rival: what is to be told apart.
        own: columns whose effort is to be left.
        as_large_as: column that gives the peak of each of them, or None where they have it.
        others: columns that may explain it, and the precision of their prior.
        weight: how much it matters.
    """

    finding: Suspect
    rival: Suspect
    own: np.ndarray
    as_large_as: int | None
    others: np.ndarray
    precision: np.ndarray
    weight: float


class Design:
    """The columns that the questions need, and what the Gram matrix of a motion says about them.

    Args:
        robot: bodies, armature and friction as known best.
        noise: of each joint's low-passed effort, (n,) [N·m].
        case: the questions; None, or one without rivals, asks for all base parameters alike.

    Attributes:
        asked: there are rivals to be told apart.
        suspects: whose columns are in the design: the findings first.
        pairs: what is to be told apart; known once a piece was seen.
        usual: information that motions hold on average: what a model is to predict where nothing is asked, (P, P).
        peaks: largest value of each column in all pieces seen, (P,).
    """

    def __init__(self, robot: Robot, noise: np.ndarray, case: Case | None = None) -> None:
        self.robot, self.noise = robot, noise
        self.relative = relative_inertials(robot)
        questions = [_by_motion(q, case, robot) for q in case.questions] if case else []
        self.questions = [q for q in questions if _tellable(q.finding)]
        self.suspects = [q.finding for q in self.questions]
        self.suspects += [r for q in self.questions for r in q.rivals]
        self.asked = any(q.rivals for q in self.questions)
        if not self.asked:
            self.suspects += [s for s in _common(robot) if not _listed(s, self.suspects)]
        self._shapes: list[Sequence[Mapping[str, float]]] = []
        self._slots: list[np.ndarray] = []
        self._own: list[int] = []
        self.pairs: list[Pair] = []
        self.usual: np.ndarray | None = None
        self.peaks = np.zeros(0)

    def gram(self, piece: Piece) -> np.ndarray:
        """Information of a piece on all columns, (P, P), in units of the noise."""
        columns = self._columns(piece)
        rows = columns[::THINNING] / self.noise[:, None]
        tall = rows.reshape(-1, columns.shape[2])
        return np.asarray(tall.T @ tall)

    def _columns(self, piece: Piece) -> np.ndarray:
        motion = motion_of(self.robot, piece)
        smooth = motion.signals.smooth
        parts = [smooth(motion.regressor @ self.relative), smooth(motion.load_rate)[..., None]]
        slots, own, at = [], [], parts[0].shape[2] + 1
        if not self._slots:
            # of the first piece: what is tried depends on the motion, and Gram matrices of all pieces add up
            self._shapes = [_shapes(suspect, motion) for suspect in self.suspects]
        for suspect, shapes in zip(self.suspects, self._shapes, strict=True):
            raw, combined = _suspect_columns(suspect, shapes, motion)
            slots.append(np.arange(at, at + raw.shape[2]))
            own.append(at + raw.shape[2])
            at += raw.shape[2] + 1
            parts += [smooth(raw), smooth(combined)[..., None]]
        if not self._slots:
            self._slots, self._own, self.peaks = slots, own, np.full(at, 1e-9)
            self._pair()
        columns = np.concatenate(parts, axis=2)
        self.peaks = np.maximum(self.peaks, np.abs(columns).max(axis=(0, 1)))
        return columns

    def _pair(self) -> None:
        links = self.robot.width * PER_LINK
        base = np.arange(links + 1)
        known = np.concatenate([np.full(links, LINK_ERROR), [STAMP_ERROR]]) ** -2.0
        for k, question in enumerate(self.questions):
            rest = [self._slots[i] for i in range(len(self.questions)) if i != k]
            for rival in question.rivals:
                slot = self._slots[self.suspects.index(rival)]
                own, size, beside = np.array([self._own[k]]), None, slot
                if question.finding.effect.name in rival.effect.contains:
                    own, size, beside = slot, self._own[k], self._slots[k]
                others = np.unique(np.concatenate([beside, *rest])).astype(int)
                precision = np.concatenate([known, np.zeros(len(others))])
                others = np.append(base, others)
                self.pairs.append(
                    Pair(question.finding, rival, own, size, others, precision, rival.probability)
                )

    def evidence(self, gram: np.ndarray) -> np.ndarray:
        """Expected evidence for each pair, (..., pairs) [nats], from Gram matrices (..., P, P)."""
        values = [_left(gram, pair, self.peaks) for pair in self.pairs]
        return np.stack(values, axis=-1) if values else np.empty((*gram.shape[:-2], 0))

    def value(self, gram: np.ndarray) -> np.ndarray:
        """The objective of a selection of pieces, (...): pairs distinguished and, with less weight, all parameters known.

        Without questions: how well a model identified from them predicts the effort of usual motions, as minus the logarithm
        of its mean squared error (V-optimal design: Atkinson, Donev, Tobias, Optimum Experimental Designs, 2007, section
        10.6).
        """
        links = self.robot.width * PER_LINK + 1
        slots = np.concatenate([np.arange(links), *self._slots]).astype(int)
        prior = np.concatenate([np.full(links, LINK_ERROR**-2.0), np.full(len(slots) - links, 1e-6)])
        known = gram[..., slots[:, None], slots] + np.diag(prior)
        if not self.asked:
            assert self.usual is not None  # as soon as pieces were drawn
            errors = np.linalg.solve(known, np.broadcast_to(self.usual[np.ix_(slots, slots)], known.shape))
            return np.asarray(-np.log(np.trace(errors, axis1=-2, axis2=-1)))
        volume = np.linalg.slogdet(known)[1] / len(slots)
        weights = np.array([pair.weight for pair in self.pairs])
        evidence = self.evidence(gram)
        enough = evidence / (1.0 + evidence / PLENTY)
        return np.asarray(np.log(SMALL + enough) @ (weights / weights.sum()) + BALANCE * volume)


def _left(gram: np.ndarray, pair: Pair, peaks: np.ndarray) -> np.ndarray:
    """Half the squared norm of a pair's own effort after the best explanation by the others, (...)."""
    inner = gram[..., pair.others[:, None], pair.others]
    cross = gram[..., pair.others[:, None], pair.own]
    ridge = pair.precision + 1e-9 * np.maximum(np.diagonal(inner, axis1=-2, axis2=-1), 1e-9)
    explained = np.sum(
        cross * np.linalg.solve(inner + ridge[..., None] * np.eye(len(pair.others)), cross), axis=-2
    )
    power = gram[..., pair.own, pair.own]
    left = np.maximum(power - explained, 0.0)
    if pair.as_large_as is None:
        return np.asarray(0.5 * left.sum(axis=-1))
    size = peaks[pair.as_large_as] / peaks[pair.own]
    return np.asarray(0.5 * np.mean(size**2 * left, axis=-1))


def motion_of(robot: Robot, piece: Piece) -> Motion:
    """A piece as a motion for effects, free of noise."""
    time = np.arange(0.0, piece.duration, 1.0 / RATE)
    path = piece.at(time)
    signals = Signals(
        time=time,
        joints=robot.joints,
        position=path.position,
        velocity=path.velocity,
        acceleration=path.acceleration,
        effort=None,
        reported_velocity=None,
        rate=RATE,
        cutoff=CUTOFF,
        segments=(slice(0, len(time)),),
        position_noise=np.zeros(robot.width),
        raw_rate=RATE,
    )
    load = robot.rigid_effort(path.position, path.velocity, path.acceleration)
    return Motion(signals, robot, load + robot.drive_effort(path.velocity, path.acceleration, signals.sign))


def _shapes(suspect: Suspect, motion: Motion) -> list[Mapping[str, float]]:
    """Nonlinear parameter values that represent a suspect without values in every piece."""
    effect = suspect.effect
    if suspect.values is not None or (suspect.link and effect.general(motion.robot, suspect.link)):
        return []
    shapes: Sequence[Mapping[str, float]] = effect.shapes(motion, suspect.target, suspect.link)
    chosen = np.unique(np.linspace(0, len(shapes) - 1, MOST_SHAPES).round().astype(int))
    return [shapes[k] for k in chosen]


def _suspect_columns(
    suspect: Suspect, shapes: Sequence[Mapping[str, float]], motion: Motion
) -> tuple[np.ndarray, np.ndarray]:
    """Columns of a suspect (N, n, k), and its effort at the estimated values (N, n), zero if there are none."""
    effect, target, link = suspect.effect, suspect.target, suspect.link
    if suspect.values is not None:
        coefficients, shape = effect.coefficients(suspect.values)
        columns = effect.columns(motion, target, shape, link)
        return columns, columns @ coefficients
    body = effect.general(motion.robot, link) if link else None
    if body is not None:  # wherever on its link it is: what is beyond any body there tells them apart
        columns = motion.regressor[:, :, of_body(body[0])] @ body[1]
    else:
        columns = np.concatenate([effect.columns(motion, target, shape, link) for shape in shapes], axis=2)
    return columns, np.zeros(columns.shape[:2])


def _tellable(suspect: Suspect) -> bool:
    return not suspect.effect.kinematic and suspect.effect.name not in TIMED


def _by_motion(question: Question, case: Case, robot: Robot) -> Question:
    """A question reduced to the rivals that a motion may distinguish from its finding."""
    return Question(question.finding, tuple(r for r in _looked_for(question, case, robot)[1] if _tellable(r)))


def _looked_for(question: Question, case: Case, robot: Robot) -> tuple[list[str], list[Suspect]]:
    """The part of a question that an inspection decides, as the diagnosis advises, and the remaining rivals."""
    finding, causes = question.finding, [one.finding for one in case.questions]
    rivals = [rival for rival in question.rivals if not same_physics(finding, rival)]
    return looked_for(finding, finding.values or {}, rivals, causes, robot, lambda one: name_of(robot, one))


def _common(robot: Robot) -> list[Suspect]:
    """Effects that almost every drive has, on every joint."""
    return [Suspect(get(name), joint, None, None, 0.0) for name in COMMON for joint in range(robot.width)]


def _listed(suspect: Suspect, among: Sequence[Suspect]) -> bool:
    return any((s.effect.name, s.target) == (suspect.effect.name, suspect.target) for s in among)


def left_out(case: Case, robot: Robot) -> list[str]:
    """A sentence for each question that another motion does not decide."""
    sentences = []
    for question in case.questions:
        sentences += _looked_for(question, case, robot)[0]
        for one in (question.finding, *question.rivals):
            if one.effect.name in TIMED:
                sentences.append(f"{one.words(robot)} acts for a time: repeat the same motion to see it go.")
            elif one.effect.kinematic:
                sentences.append(f"{one.words(robot)} shows in the reported velocity of any quick motion.")
    return list(dict.fromkeys(sentences))
