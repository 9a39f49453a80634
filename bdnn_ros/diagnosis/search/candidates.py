"""Candidate terms: which effects are tried, where, and with which shapes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy.optimize import minimize

from bdnn_ros.aside import in_two
from bdnn_ros.diagnosis.pushes.pushes import best_push, piece_of, refined_push
from bdnn_ros.diagnosis.regression.building import least_motion
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import COMMON, Term
from bdnn_ros.effects.base import Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import ALL, Installed
from bdnn_ros.robot import Robot

RELINEARISATIONS = 4
CONSISTENT = 0.1
"""Relative change of a shape below which columns linearised at it are exact enough."""
CLOSELY, INDIFFERENT = 1e-3, 1e-2
"""Tolerances of shape refinement: relative change of the shape, and gain [nats]."""
ANGLES = {"base_tilt", "position_offset"}
"""Kinds that are the same angle where a joint turns about the axis about which the base tilts."""
LIKE_WEIGHT = {*ANGLES, "effort_scale"}
"""Kinds that act on a joint which moves alone as a carried body does, without being one."""


@dataclass(frozen=True)
class Candidates:
    """Every effect at every place of a robot."""

    terms: tuple[Term, ...]
    robot: Robot
    earlier_effects: Sequence[Installed] | None = None
    """Effects of the earlier model beside its robot, and loads on it; None against a simulation."""

    @classmethod
    def of(cls, robot: Robot, bodies: bool = True) -> Candidates:
        """All effects of the registry that act on the effort, at all joints and moving links of a robot.

        Args:
            bodies: include those that change the apparent weight of bodies or the direction of gravity.
        """
        terms: list[Term] = []
        for effect in ALL:
            of_weight = effect.on_body or effect.name in LIKE_WEIGHT
            if effect.kinematic or (of_weight and not bodies):
                continue
            for target, link in effect.places(robot):
                terms.append(Term(effect, target, link))
        return cls(tuple(terms), robot)

    @classmethod
    def shown_by(cls, equations: Equations, earlier_effects: Sequence[Installed] | None = None) -> Candidates:
        """Candidates that a recording can tell apart.

        Without those of bodies if only one joint moves. Without those that change with time, or periodically with position, at
        joints that move briefly: what differs between a few moves may differ by time or by place. Without those that no shape
        shows along this motion.

        Args:
            earlier_effects: effects that an earlier model has beside its robot, if one takes the simulation's place;
                candidates are then changes from these, which may be negative.
        """
        motion = equations.motion
        every = cls.of(motion.robot, bodies=equations.alone is None)
        lasting, carries = equations.rows.moving >= least_motion(motion.signals), every.robot.carries

        def lasts(term: Term) -> bool:
            shown_at = carries[:, term.target] if term.link else [term.target]
            return bool(lasting[shown_at].any())

        def shows(term: Term) -> bool:
            effect, shapes = term.effect, term.shapes(motion)
            if (effect.changing or effect.winding) and not lasts(term):
                return False
            allowed = [shape for shape in shapes if not effect.winding or effect.shape_allowed(shape)]
            return any(effect.resolved(motion, term.target, shape) for shape in allowed)

        kept = [term for term in every.terms if shows(term)]
        return cls(
            tuple(_as_change(term, every.robot, earlier_effects) for term in kept),
            every.robot,
            earlier_effects,
        )

    def settled(self, term: Term, motion: Motion) -> Term | None:
        """What a term settles into, as a change like all candidates; None if nothing."""
        plain = term.settled(motion)
        return None if plain is None else _as_change(plain, self.robot, self.earlier_effects)

    def common(self) -> list[Term]:
        """Candidates of the common kinds at all joints."""
        return [term for term in self.terms if term.effect.name in COMMON]

    def shaped(self, equations: Equations, pool: Pool, fit: Fit) -> list[Term]:
        """Candidates that are not in the pool, each with its best shape beside the pool's terms.

        A push already in the pool may recur at its place.
        """
        present = {term.place for term in pool.terms}
        free = (
            next((one for one in _recurring(term) if one.place not in present), None) for term in self.terms
        )
        absent = [term for term in free if term is not None]
        shapes = in_two(lambda term: self._best(equations, pool, fit, term).shape, absent)
        return [replace(term, shape=shape) for term, shape in zip(absent, shapes, strict=True)]

    def _best(self, equations: Equations, pool: Pool, fit: Fit, term: Term) -> Term:
        """A candidate with its best shape beside a pool's terms."""
        if term.effect.timed:
            return best_push(pool, fit, term, self.robot)[1]
        shapes = term.shapes(equations.motion)
        if len(shapes) > 1:
            return _consistent(pool, fit, _best_of(pool, fit, term, shapes)[1])
        beside = pool.fit([c for c in fit.terms if not _elsewhere(term, pool.terms[c])])
        return _relinearised(equations, pool, beside, term.shaped(shapes[0]))

    def anew(self, equations: Equations, pool: Pool, fit: Fit, one: int) -> Pool:
        """The pool with one term's shape replaced by the best of its grid beside a fit without it, if that gains."""
        term = pool.terms[one]
        shapes = term.shapes(equations.motion)
        if len(shapes) == 1:
            return pool
        gain, found = _best_of(pool, fit, term, shapes)
        return pool.replacing({one: found}) if gain > pool.gain_of(fit, term)[0] else pool

    def refined(self, equations: Equations, pool: Pool, fit: Fit, chosen: int) -> Term:
        """A term of a fit with its shape refined beside the others, whose active bounds are kept."""
        term = pool.terms[chosen]
        if not term.shape:
            return term
        rest = pool.without(fit, [c for c in fit.terms if c == chosen or piece_of(pool.terms[c], term)])
        term = _relinearised(equations, pool, rest, term)
        if term.effect.timed:
            return refined_push(pool, rest, term, self.robot)
        bounds = term.effect.shape_bounds if term.effect.kept is None else {}
        free = tuple(name for name in dict(term.shape) if name in bounds)
        if not free:
            return term
        moved = _refined(equations, pool, rest, term, free)
        before, after = (pool.replacing({chosen: one}).fit(fit.terms).evidence for one in (term, moved))
        return moved if after > before else term

    def load(self, equations: Equations, pool: Pool, fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Acting effort by the fit and the part of it that drives take before the gear, at the working rate, (N, n) [N·m]
        each, and the acting effort per measured effort, (n,)."""
        motion, decimation = equations.motion, equations.decimation
        links, simulated = equations.rigid.shape[2], decimation.simulated
        assert simulated.drive is not None
        # the lag of friction in sticking is part of the load, so that a delay shifts it like the rest
        late = motion.derivative(motion.signals.sign) * pool.nuisances(fit)[equations.nuisances.sticking]
        errors = motion.regressed(equations.errors.relative @ fit.coefficients[:links])
        base = simulated.load + decimation.with_load_friction(errors) + decimation.with_load_friction(late)
        drive = simulated.drive + late
        for chosen in fit.terms:
            term = pool.terms[chosen]
            if term.effect.at_sensor:
                continue
            coefficients = acting_per_measured(pool, fit, chosen) * pool.coefficients(fit, chosen)
            part = term.effect.columns(motion, term.target, dict(term.shape), term.link) @ coefficients
            base += decimation.with_load_friction(part)
            if term.effect.in_drive:
                drive += part
        return np.asarray(base), drive, effort_scales(pool, fit)

    def bodies(self, equations: Equations, pool: Pool, fit: Fit) -> tuple[Robot, np.ndarray]:
        """The robot by the fit (links corrected, with payloads and scaled links) and the joints' zero offsets, (n,) [rad].

        A tilt, bend or wrong zero acts on all of that mass.
        """
        links = equations.rigid.shape[2]
        errors = equations.errors.relative @ fit.coefficients[:links]
        plant = Plant(equations.motion.robot.with_inertials(self.robot.inertials.ravel() + errors))
        for chosen in fit.terms:
            term = pool.terms[chosen]
            if term.effect.on_body or term.effect.name == "position_offset":
                coefficients = pool.coefficients(fit, chosen)
                values = term.effect.values(coefficients, dict(term.shape))
                term.effect.install(plant, term.target, values, term.link)
        return plant.robot, plant.position_offset


def _recurring(term: Term) -> Iterator[Term]:
    """A term and, if it acts for a time, its further occurrences without end."""
    return (replace(term, again=again) for again in count()) if term.effect.timed else iter([term])


def acting_per_measured(pool: Pool, fit: Fit, chosen: int) -> float:
    """Acting effort per unit of a term's coefficient: the joint's effort scale for drive terms and offsets, else 1.

    Drive effort is measured in the sensor's units, which a wrong effort scale changes. An offset is counted in acting effort.
    """
    term = pool.terms[chosen]
    measured = term.effect.in_drive or term.effect.name == "effort_offset"
    return float(effort_scales(pool, fit)[term.target]) if measured else 1.0


def effort_scales(pool: Pool, fit: Fit) -> np.ndarray:
    """Effort scale of each joint in a fit, 1 without one, (n,)."""
    result = np.ones(pool.equations.rows.width)
    for chosen in fit.terms:
        term = pool.terms[chosen]
        if term.effect.name == "effort_scale":
            result[term.target] = term.effect.values(pool.coefficients(fit, chosen), {})["scale"]
    return result


def _as_change(term: Term, robot: Robot, since: Sequence[Installed] | None) -> Term:
    """A term as a change from the description, or from what an earlier model has at its place."""
    if since is None:
        return replace(term, effect=term.effect.against(robot, term.target))
    held: dict[str, list[Values]] = {}
    for one in since:
        effect, everywhere = one.effect, one.target < 0 <= term.target and one.effect.on == "all"
        steady = not (effect.timed or effect.changing or effect.kinematic)
        if steady and (everywhere or (one.target, one.link) == (term.target, term.link)):
            held.setdefault(effect.name, []).append(one.values)
    return replace(term, effect=term.effect.since(robot, term.target, term.link, held))


def _best_of(pool: Pool, fit: Fit, term: Term, shapes: Sequence[dict[str, float]]) -> tuple[float, Term]:
    """The gain of the best of some shapes of a term beside a fit, and the term with it."""
    tried = [term.shaped(shape) for shape in shapes]
    gains = pool.gains_of_shapes(fit, tried)
    best = int(np.argmax(gains))
    return float(gains[best]), tried[best]


def _elsewhere(term: Term, other: Term) -> bool:
    """Whether another term may be what this one would replace: the same on another link, or a tilt for a joint's zero."""
    same = term.link is not None and term.effect.name == other.effect.name
    return same or {term.effect.name, other.effect.name} == ANGLES


def _relinearised(equations: Equations, pool: Pool, fit: Fit, term: Term) -> Term:
    """The term with columns linearised at the shape that fits best beside a fit: gains at other shapes are not real."""
    if not term.shape:
        return term
    ends = [_consistent(pool, fit, start) for start in (term, *_generally(equations, pool, fit, term))]
    return ends[0] if len(ends) == 1 else max(ends, key=lambda end: pool.gain_of(fit, end)[0])


def _generally(equations: Equations, pool: Pool, fit: Fit, term: Term) -> list[Term]:
    """The term with the shape of a more general effect's best fit, as a start; empty if there is no such effect."""
    body = term.effect.general(equations.motion.robot, term.link) if term.link else None
    if body is None:
        return []
    _, coefficients = pool.gain_of(fit, term, equations.columns.of_body(*body))
    return [term.shaped(term.effect.relinearised(coefficients, dict(term.shape)))]


def _consistent(pool: Pool, fit: Fit, term: Term) -> Term:
    """The term whose columns are linearised at the shape they yield, by fixed-point iteration."""
    if not term.effect.linearised_at:
        return term
    for _ in range(RELINEARISATIONS):
        _, coefficients = pool.gain_of(fit, term)
        moved = term.shaped(term.effect.relinearised(coefficients, dict(term.shape)))
        before, after = (np.array([value for _, value in one.shape]) for one in (term, moved))
        if np.linalg.norm(after - before) <= CONSISTENT * np.linalg.norm(after):
            break
        term = moved
    return term


def _refined(equations: Equations, pool: Pool, fit: Fit, term: Term, names: Sequence[str]) -> Term:
    """The term with its free shape parameters optimised for evidence beside a fit."""
    fixed, motion = dict(term.shape), equations.motion
    start = np.array([fixed[name] for name in names])
    scale = np.where(np.abs(start) > 1e-9, np.abs(start), 1.0)

    def moved(x: np.ndarray) -> dict[str, float]:
        return {**fixed, **dict(zip(names, (x * scale).tolist(), strict=True))}

    def loss(x: np.ndarray) -> float:
        shape = moved(x)
        if not (term.effect.shape_allowed(shape) and term.effect.resolved(motion, term.target, shape)):
            return 1e9
        return -pool.gain_of(fit, term.shaped(shape))[0]

    first = loss(start / scale)
    options = {"maxfev": 30 * len(names), "xatol": CLOSELY, "fatol": INDIFFERENT}
    best = minimize(loss, start / scale, method="Nelder-Mead", options=options)
    return term.shaped(moved(best.x)) if best.fun < first else term
