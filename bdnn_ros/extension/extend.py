"""From a diagnosis to the extended model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.recorded.compared import offsets_of
from bdnn_ros.diagnosis.recorded.velocity_filter import none_is_left
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.joint_errors import CONTRACT_SIGNS, STRAIGHT
from bdnn_ros.diagnosis.regression.term import COMMON
from bdnn_ros.diagnosis.search.leads import lead_and_delays
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.effects.rigid import POINT, Payload
from bdnn_ros.errors import UsageError
from bdnn_ros.extension.earlier import Known, at_another_time, by_the_clock, known_effects, with_effects
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.holding import IN_BODIES, IN_ROBOT, plant_of
from bdnn_ros.extension.identified import filters_of, of_physical
from bdnn_ros.extension.merging import merged
from bdnn_ros.extension.recorded import on_one_clock
from bdnn_ros.extension.unsure import joints_moved, unsure_of
from bdnn_ros.physical.consistency import consistent
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.mounting import tilt_of

SURE = 2.0
"""A lead of dry friction is worth keeping at so many standard deviations."""


def extend(examination: Examination) -> ExtendedModel:
    """The extended model of a diagnosis: corrected links, every finding, and effects too uncertain to be named.

    A push that was not named is left out, since nothing pushes at that time in another recording.

    The link errors are those of the fit, moved as little as its information allows to physically possible bodies (with the
    effects on them), so that M(q) is positive-definite. If an earlier model was compared, its effects and offsets come first,
    as they are at another time. Its sensor effects were removed from the recordings before the comparison, and are added
    again.

    Raises:
        UsageError: that model holds more than a robot with effects.
    """
    equations, fit = examination.equations, examination.fit
    earlier, sensors = _earlier(examination)
    robot = earlier.bare
    found, stds = _found(examination, robot)
    links = equations.rigid.shape[2]
    errors, corrected = fit.coefficients[:links], corrected_links(robot, found, *_bodies(examination))
    earlier, corrected = _joints_moved(earlier, corrected, equations, errors)
    before: list[Known] = known_effects(earlier)
    if equations.errors.unsure is not None:
        known = fit.covariance[:links, :links]
        corrected, more = joints_moved(corrected, before, equations.errors.unsure, errors, known)
        before += more
    rows = equations.usable & examination.test[:, None]
    error = np.where(rows, examination.extended, 0.0)
    noise = np.sqrt(np.sum(error**2, axis=0) / np.maximum(rows.sum(axis=0), 1))
    rate = equations.motion.signals.raw_rate
    gone = [one for one in found if one.effect.kinematic and none_is_left(one.values["cutoff"], rate)]
    both = merged(corrected, [*before, *sensors, *zip(found, stds, strict=True)])
    effects = [one for one in both if one[0] not in gone]
    scale = plant_of(robot, [effect for effect, _ in sensors]).scale
    late = examination.late
    lead = earlier.lead + lead_and_delays(examination.pool, fit)[0] - late.delay
    sticking = _sticking(examination, corrected, found)
    creep = equations.motion.signals.creep
    if earlier.sticking:
        sticking = sticking + earlier.sticking
    model = ExtendedModel(
        corrected,
        tuple(effect for effect, _ in effects),
        noise / scale,
        tuple(std for _, std in effects),
        lead,
        earlier.lag + late.lag,
        earlier.beyond,
        tuple(sticking.tolist()),
        () if creep is None else tuple(map(tuple, creep.tolist())),
        on_one_clock(examination.recordings) if any(by_the_clock(one) for one, _ in effects) else (),
        unsure_of(examination),
        (*earlier.networks, *examination.networks),
    )
    return _bearing(model)


def _found(examination: Examination, robot: Robot) -> tuple[list[Installed], list[dict[str, float]]]:
    """The findings as effects, with standard deviations of their values."""
    estimates = [e for e in examination.estimates if not e.term.effect.timed or _told(e, examination)]
    found = [Installed(e.term.effect, e.term.target, e.term.link, dict(e.values)) for e in estimates]
    stds = [{name: q.std for name, q in e.quantities.items()} for e in estimates]
    for finding in examination.diagnosis.findings:
        effect = get(finding.effect)
        if effect.kinematic:
            values = {name: q.value for name, q in finding.parameters.items()}
            found.append(Installed(effect, robot.joints.index(str(finding.joint)), finding.link, values))
            stds.append({name: q.std for name, q in finding.parameters.items()})
    return _tilted_further(robot, found), stds


def _bearing(model: ExtendedModel) -> ExtendedModel:
    """The model with the new bodies as the load of its learned joint terms, some of which grow with the load."""
    if model.beyond is None:
        return model
    robot = model.robot
    robot = replace(robot, zeros=robot.zeros + model.plant.position_offset)
    return replace(model, beyond=replace(model.beyond, robot=robot))


def _earlier(examination: Examination) -> tuple[ExtendedModel, list[Known]]:
    """The model that was compared, as a robot with the effects that it cannot hold itself, and its sensor effects."""
    model, none = examination.model, np.zeros(examination.robot.width)
    if model is None:
        return ExtendedModel(examination.robot, (), none), []
    if isinstance(model, ExtendedModel):
        acting, sensors = at_another_time(model)
        beside = [one for one in known_effects(acting) if one[0].effect.name not in IN_ROBOT]
        return with_effects(replace(acting, bare=acting.robot), beside), sensors
    if isinstance(model, PhysicalModel):
        return of_physical(model), filters_of(model)
    raise UsageError(
        "The model compared with has learned more than a robot with effects can say.",
        "Identify the earlier recording with --prior urdf.",
    )


def _sticking(examination: Examination, robot: Robot, effects: Sequence[Installed]) -> np.ndarray:
    """Lead of each joint's dry friction [N·m·s], (n,); zero if the joint has none or the data do not show it.

    The fit has this term for every joint, but hardly a row says anything about it where no dry friction reverses.
    """
    equations, fit = examination.equations, examination.fit
    links = equations.rigid.shape[2]
    rows = np.arange(links + equations.nuisances.sticking.start, links + equations.nuisances.sticking.stop)
    found, stds = fit.coefficients[rows], np.sqrt(np.diag(fit.covariance)[rows])
    dry = robot.coulomb > 0.0
    dry[[joint for joint, _ in plant_of(robot, effects).dry]] = True
    return np.where(dry & (np.abs(found) > SURE * stds), found, 0.0)


def corrected_links(
    robot: Robot,
    effects: Sequence[Installed],
    relative: np.ndarray,
    errors: np.ndarray,
    covariance: np.ndarray,
) -> Robot:
    """The robot with link errors added, feasible together with the effects on its bodies, and without its payloads.

    Args:
        relative: from errors to inertial parameters, (n · PER_LINK, U).
        errors, covariance: belief in the errors, (U,) and (U, U).
    """
    of_links = [e for e in effects if e.effect.name in IN_BODIES and not _hangs(e)]
    bodies = plant_of(robot, of_links).robot.inertials
    added = (bodies - robot.inertials).ravel()
    mean = robot.inertials.ravel() + relative @ errors + added
    triangle = np.linalg.qr((relative @ np.linalg.cholesky(covariance)).T, mode="r")
    back = np.linalg.inv(triangle)
    information = back @ back.T
    total = consistent(mean, 0.5 * (information + information.T), robot.width, np.array([], dtype=int))
    return robot.with_inertials((total - added).reshape(-1, PER_LINK))


def _hangs(effect: Installed) -> bool:
    """Whether the effect is a body of its own, attached to a link that can exist without it."""
    return effect.effect.name == Payload.name and effect.values["mass"] > 0.0


def _told(push: Estimate, examination: Examination) -> bool:
    """Whether a push is a finding."""
    start = push.quantities["start"].value
    same = (f for f in examination.diagnosis.findings if f.effect == push.term.effect.name)
    return any(finding.parameters["start"].value == start for finding in same)


def _bodies(examination: Examination) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The uncertainty of the bodies as `corrected_links` takes it: link errors, and what the values of payloads leave open.

    The latter is a payload's inertia about its own centre. Everything else stays as found: bodies move as little as the
    remaining effort allows, and a link is no better known together with its payload than the effort is.
    """
    equations, fit, pool = examination.equations, examination.fit, examination.pool
    columns, rows = [equations.errors.relative], [np.arange(equations.errors.relative.shape[1])]
    for chosen in fit.terms:
        effect, link = pool.terms[chosen].effect, pool.terms[chosen].link
        if isinstance(effect, Payload) and link is not None:
            body, at = examination.robot.body_of(link)[0], pool.rows(fit, chosen)
            columns.append(
                np.eye(len(equations.errors.relative))[:, body * PER_LINK + POINT : (body + 1) * PER_LINK]
            )
            rows.append(np.arange(at.start + POINT, at.stop))
    known = np.concatenate(rows)
    precision = (fit.factor @ fit.factor.T)[np.ix_(known, known)]
    return np.concatenate(columns, axis=1), fit.coefficients[known], np.linalg.inv(precision)


def _joints_moved(
    earlier: ExtendedModel, robot: Robot, equations: Equations, errors: np.ndarray
) -> tuple[ExtendedModel, Robot]:
    """A model's joint terms, and a robot with armature, viscous and Coulomb friction corrected by their errors (U,).

    None becomes negative; both are unchanged if no model was identified. Learned joint terms keep only what linear friction
    cannot express, since files for other programs can hold only that.
    """
    open_ = equations.errors.joints
    if open_ is None or not errors.any():
        return earlier, robot
    moved = (open_.parameters @ errors).reshape(len(COMMON), -1)
    learned = None
    if earlier.beyond is not None:
        learned = open_.moved(earlier.beyond.learned, errors)
    given = np.zeros((len(STRAIGHT), robot.width))
    if learned is not None:
        given = open_.handed_back(equations.columns, equations.usable, learned)
        friction = np.array([robot.viscous, robot.coulomb]) + moved[1:-1]
        given[:-1] = np.maximum(given[:-1], -friction)
        learned = replace(learned, straight=learned.straight + given.T * CONTRACT_SIGNS)
    moved[1:] += given
    kinds = ("armature", "viscous", "coulomb")
    joints = {kind: np.maximum(getattr(robot, kind) + e, 0.0) for kind, e in zip(kinds, moved, strict=False)}
    earlier = _offsets_moved(earlier, moved[COMMON.index("effort_offset")])
    if earlier.beyond is not None:
        earlier = replace(earlier, beyond=replace(earlier.beyond, learned=learned))
    return earlier, robot.with_joint_parameters(**joints)


def _offsets_moved(model: ExtendedModel, errors: np.ndarray) -> ExtendedModel:
    """The model with its effort offsets corrected by their errors, (n,) [N·m]."""
    known, there = [], set()
    for effect, std in known_effects(model):
        if effect.effect.name == "effort_offset":
            there.add(effect.target)
            effect = replace(
                effect, values={"offset": effect.values["offset"] + float(errors[effect.target])}
            )
        known.append((effect, std))
    more = offsets_of(np.where([joint in there for joint in range(len(errors))], 0.0, -errors))
    return with_effects(model, [*known, *((one, {}) for one in more)])


def _tilted_further(robot: Robot, found: Sequence[Installed]) -> list[Installed]:
    """Effects whose tilt counts from level instead of from the tilt that the robot already has."""
    before = dict(
        zip(("roll_deg", "pitch_deg"), np.degrees(tilt_of(robot.gravity_vector)).tolist(), strict=True)
    )
    return [
        replace(e, values={key: value + before[key] for key, value in e.values.items()})
        if e.effect.name == "base_tilt"
        else e
        for e in found
    ]
