"""Selects pieces of motion that together distinguish the rivals of a diagnosis.

Pieces are drawn at random within the limits. Their information adds up, so the best set is built by adding the piece that
helps most, then by exchanging pieces while that helps (Fedorov, Theory of Optimal Experiments, 1972).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bdnn_ros.errors import DataError, UsageError, listed
from bdnn_ros.excitation.bounds import Bounds
from bdnn_ros.excitation.motions import Piece, changed, drawn
from bdnn_ros.excitation.rivals import Case, Suspect
from bdnn_ros.excitation.routes import joined, way
from bdnn_ros.excitation.separation import Design, left_out
from bdnn_ros.excitation.whole import LONGEST, whole
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory
from bdnn_ros.simulation.sensors import Noise

DRAWS = 160
"""Pieces drawn at first, and again near the best ones."""
CHANGES = 60
PIECE_SECONDS = 4.0
"""Length of a piece, shorter for short motions [s]."""
SHORTEST_WAY = 0.5
"""What it takes at least from one piece to the next [s]."""
FEWEST = 3
"""Pieces that a motion is made of at least."""
EXCHANGES = 3
BATCH = 40
"""Pieces compared at once: more take memory, not time."""
NOISE_SHARE = 0.01
"""Effort noise where none was measured, as a share of the effort limit."""
TRAVEL = 10.0 * Noise.position
"""A joint that travels less, ten times a usual encoder's noise, shows nothing [rad] ([m])."""
DECISIVE = 10.0
"""Expected evidence above which a question counts as settled [nats]."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Separation:
    """The expected evidence of a motion for a finding against its rival."""

    finding: Suspect
    rival: Suspect
    evidence: float

    @property
    def settled(self) -> bool:
        """Whether the expected evidence is decisive."""
        return self.evidence >= DECISIVE


@dataclass(frozen=True)
class Excitation:
    """The motion, what it should decide, notes on what no such motion can decide, and joints that hardly move in it."""

    trajectory: Trajectory
    separations: tuple[Separation, ...]
    notes: tuple[str, ...]
    still: tuple[str, ...] = ()


def excite(
    robot: Robot,
    case: Case | None = None,
    *,
    bounds: Bounds | None = None,
    duration: float = 30.0,
    rate: float = 100.0,
    seed: int = 0,
    progress: Progress | None = None,
) -> Excitation:
    """A motion within the limits that distinguishes the rivals of a diagnosis, or excites all parameters.

    Args:
        robot: bodies, armature and friction as known best; limits.
        case: what a diagnosis left open; None asks for all base parameters alike.
        bounds: limits to keep; None takes the robot's, with a reserve.
        duration: how long it may take [s].
        rate: points a second [Hz].

    Raises:
        UsageError: duration or rate make no sense.
        DataError: no motion was found that keeps the limits, or none that encoders would see.
    """
    if not 4.0 <= duration <= 600.0:
        raise UsageError(f"A motion of {duration:g} s makes no sense.", "Use 4 to 600 s.")
    if not 10.0 <= rate <= 1000.0:
        raise UsageError(f"A rate of {rate:g} Hz makes no sense.", "Use 10 to 1000 Hz.")
    say = progress or (lambda text: None)
    bounds = bounds or Bounds.of(robot)
    design = Design(robot, _noise(robot, case), case)
    search = _Search(robot, bounds, design, duration, np.random.default_rng(seed), say)
    pieces = search.run()
    if not design.asked and duration <= LONGEST:
        pieces = _better(design, pieces, whole(bounds, design, duration, search.rng, say))
    say("joining")
    trajectory = joined(bounds, pieces, rate)
    if trajectory is None:
        raise DataError("No way between the motion's parts keeps the effort limits.", "Widen the limits.")
    gram = sum(design.gram(piece) for piece in pieces)
    evidence = design.evidence(np.asarray(gram))
    separations = [
        Separation(pair.finding, pair.rival, float(value))
        for pair, value in zip(design.pairs, evidence, strict=True)
    ]
    notes = left_out(case, robot) if case else []
    still = _still(trajectory, robot)
    if still:
        hidden = f"less than {TRAVEL:g} rad (or m), which encoders hardly see"
        remedy = "Allow more velocity and acceleration, or a wider range."
        if len(still) == robot.width:
            raise DataError(f"Inside these limits every joint travels {hidden}.", remedy)
        notes.append(f"{listed(still)}: travels {hidden}, and shows nothing. {remedy}")
    return Excitation(trajectory, tuple(separations), tuple(notes), still)


def _still(trajectory: Trajectory, robot: Robot) -> tuple[str, ...]:
    """Joints that travel no further than the noise of their encoders."""
    travel = np.ptp(trajectory.position, axis=0)
    return tuple(joint for joint, far in zip(robot.joints, travel, strict=True) if far < TRAVEL)


def _better(design: Design, pieces: list[Piece], one: Piece | None) -> list[Piece]:
    """Several pieces, or one that takes all the time: the better choice."""
    together = np.asarray(sum(design.gram(piece) for piece in pieces))
    if one is None or design.value(design.gram(one)) <= design.value(together):
        return pieces
    return [one]


def _noise(robot: Robot, case: Case | None) -> np.ndarray:
    """Noise of each joint's effort, (n,) [N·m]."""
    limits = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 100.0)
    noise = NOISE_SHARE * limits
    if case is not None:
        for joint, value in zip(case.joints, case.noise, strict=True):
            if value > 0.0:
                noise[robot.joints.index(joint)] = value
    return np.asarray(noise)


class _Search:
    """The search for the pieces of a motion."""

    def __init__(
        self,
        robot: Robot,
        bounds: Bounds,
        design: Design,
        duration: float,
        rng: np.random.Generator,
        say: Progress,
    ) -> None:
        self.robot, self.bounds, self.design, self.rng, self.say = robot, bounds, design, rng, say
        self.duration = duration
        self.length = min(PIECE_SECONDS, duration / (FEWEST + 1))
        self.home: Piece | None = None
        self.pieces: list[Piece] = []
        self.grams: list[np.ndarray] = []

    def run(self) -> list[Piece]:
        """The best set of pieces, in an order with short transitions."""
        focus = self._focus()
        for k in range(DRAWS):
            if k % 20 == 0:
                self.say(f"drawing motions {k}/{DRAWS}")
            self._take(drawn(self.bounds, self.length, focus, self.rng))
        if not self.pieces:
            raise DataError(
                "No motion was found that keeps the limits.",
                "Check the effort limits: they should at least hold the arm against gravity.",
            )
        self.design.usual = np.mean(self.grams, axis=0)
        count = int(np.ceil(self.duration / (self.length + SHORTEST_WAY)))
        chosen = self._connected(self._grown(count))
        self.say("refining")
        for k in range(CHANGES):
            self._take(changed(self.bounds, self.pieces[chosen[k % len(chosen)]], self.rng))
        return self._short_enough(self._connected(chosen))

    def _take(self, piece: Piece | None) -> None:
        if piece is not None and (self.home is None or self._to_and_fro(self.home, piece)):
            self.pieces.append(piece)
            self.grams.append(self.design.gram(piece))

    def _connected(self, chosen: list[int]) -> list[int]:
        """The best pieces near some; of one region, where no order has ways from each piece to the next."""
        chosen = self._exchanged(chosen)
        if self.home is None and len(self._ordered(chosen)[0]) < len(chosen):
            self._stay_in_one_region()
            chosen = self._exchanged(self._grown(len(chosen)))
        return chosen

    def _stay_in_one_region(self) -> None:
        """Keep the pieces between which transitions exist both ways: the most informative set of these.

        An arm too weak to be held stretched out may hang or stand upright, but cannot move from one to the other.
        """
        self.say("looking for ways")
        left, regions = list(range(len(self.pieces))), list[list[int]]()
        while left:
            first, *others = left
            regions.append(
                [first, *(k for k in others if self._to_and_fro(self.pieces[first], self.pieces[k]))]
            )
            left = [k for k in others if k not in regions[-1]]
        kept = max(regions, key=lambda region: float(self.design.value(self._total(region))))
        self.home = self.pieces[kept[0]]
        self.pieces, self.grams = [self.pieces[k] for k in kept], [self.grams[k] for k in kept]

    def _to_and_fro(self, a: Piece, b: Piece) -> bool:
        return way(self.bounds, a.end, b.centre)[1] and way(self.bounds, b.end, a.centre)[1]

    def _focus(self) -> np.ndarray:
        """Importance of each joint, (n,): that of the questions most, of joints that carry a link in question some."""
        focus = np.full(self.robot.width, 0.05)
        for suspect in self.design.suspects if self.design.asked else ():
            if suspect.target < 0:
                focus += 0.5
            elif suspect.link is not None:
                focus[self.robot.carries[:, suspect.target]] += 0.5
            else:
                focus[suspect.target] += 1.0
        return focus

    def _total(self, chosen: list[int]) -> np.ndarray:
        return np.asarray(np.sum([self.grams[k] for k in chosen], axis=0)) + np.zeros_like(self.grams[0])

    def _best(self, chosen: list[int]) -> int:
        """The piece that adds most to the chosen ones."""
        total, values = self._total(chosen), []
        for first in range(0, len(self.grams), BATCH):
            values.append(self.design.value(total + np.array(self.grams[first : first + BATCH])))
        return int(np.argmax(np.concatenate(values)))

    def _grown(self, count: int) -> list[int]:
        chosen: list[int] = []
        for k in range(count):
            self.say(f"choosing {k + 1}/{count}")
            chosen.append(self._best(chosen))
        return chosen

    def _exchanged(self, chosen: list[int]) -> list[int]:
        """Replace pieces by better ones until no exchange helps."""
        for _ in range(EXCHANGES):
            before = list(chosen)
            for k in range(len(chosen)):
                self.say(f"exchanging {k + 1}/{len(chosen)}")
                rest = chosen[:k] + chosen[k + 1 :]
                chosen = [*rest[:k], self._best(rest), *rest[k:]]
            if chosen == before:
                break
        return chosen

    def _short_enough(self, chosen: list[int]) -> list[Piece]:
        """The pieces in an order with short transitions; the least useful ones are dropped until the time suffices."""
        while True:
            order, time = self._ordered(chosen)
            if time <= self.duration or len(order) == 1:
                return [self.pieces[chosen[k]] for k in order]
            chosen = [chosen[k] for k in sorted(order)]
            total = self._total(chosen)
            values = [float(self.design.value(total - self.grams[k])) for k in chosen]
            chosen = [c for k, c in enumerate(chosen) if k != int(np.argmax(values))]

    def _ordered(self, chosen: list[int]) -> tuple[list[int], float]:
        """Order of the chosen pieces by nearest neighbour from the best start, and their total time [s].

        Unreachable pieces are dropped: the longest chain counts first, then the shortest time.
        """
        pieces = [self.pieces[k] for k in chosen]
        ways = [[self._time(a.end, b.centre) for b in pieces] for a in pieces]
        best, shortest = list[int](), np.inf
        for start in range(len(pieces)):
            order, left, time = [start], set(range(len(pieces))) - {start}, 0.0
            while left:
                nearest = min(left, key=lambda k: ways[order[-1]][k])
                if ways[order[-1]][nearest] == np.inf:
                    break
                time += ways[order[-1]][nearest]
                order.append(nearest)
                left.remove(nearest)
            if (-len(order), time) < (-len(best), shortest):
                best, shortest = order, time
        return best, shortest + sum(pieces[k].duration for k in best)

    def _time(self, start: np.ndarray, end: np.ndarray) -> float:
        """Duration of the transition between two poses (n,) [s], infinite if there is none."""
        time, possible = way(self.bounds, start, end)
        return time if possible else np.inf
