"""Groups of physical.py: feasible bodies, honest intervals, recordings that agree, and nothing forgotten."""

from __future__ import annotations

import argparse
from typing import Any
from unittest.mock import patch

import numpy as np
from _physical_data import PIECE, Real, motions, real, rough, tests
from _physical_measures import Itself, poses, torque_error, true_error

from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.agreement import agreement
from bdnn_ros.physical.combinations import combinations
from bdnn_ros.physical.consistency import feasible
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Parameters, prior
from bdnn_ros.recording import Recording

EARLY = (1.0, 2.0, 5.0, 10.0)
POSES = 1000
COMPARED = 5
"""Seeds whose torque errors are compared with and without asking for feasible bodies."""
NARROW = 0.05
"""Size of a narrow motion, of the wide one's."""
COVERED = 20.0
"""Seconds of motion whose intervals are judged."""
NORMAL = 1.96
IDENTIFIED = 0.5
"""Intervals are judged of combinations that the motion told this much better than the prior, and better."""


def definite(args: argparse.Namespace) -> dict[str, Any]:
    """M positive-definite and inertias feasible from the first second on, and what asking for that costs."""
    seeds, rows = args.seeds or 20, []
    measured = max(min(seeds, COMPARED), 1)
    for seconds in EARLY:
        counts = np.zeros(4, int)
        errors_of = []
        for seed in range(seeds):
            one = real(seed, "unmodelled")
            q = poses(one.nominal, POSES, seed)
            identifier = Identifier(one.nominal)
            model = identifier.fit(motions(one, seconds, seed))
            free = _without_asking(identifier)
            counts += [
                feasible(model.robot.inertials),
                _definite(model, q),
                feasible(free.robot.inertials),
                _definite(free, q),
            ]
            if seed < measured:
                others = tests(one, seed)[:1]
                errors_of.append([torque_error(model, others), torque_error(free, others)])
        with_it, without = np.mean(errors_of, axis=0)
        rows.append({"seconds": seconds, "counts": counts.tolist(), "nmse": [with_it, without]})
    print(f"{seeds} seeds, {POSES} poses each; torque nMSE of {measured} seeds; with unmodelled effects")
    print(f"{'':8} {'with it: feasible':>20} {'M definite':>12} {'nMSE':>10} ", end="")
    print(f"{'without: feasible':>18} {'M definite':>12} {'nMSE':>10}")
    for row in rows:
        ours, definite_, free_, free_definite = row["counts"]
        with_it, without = (f"{100 * x:8.3f} %" for x in row["nmse"])
        print(
            f"{row['seconds']:6g} s {ours:17}/{seeds} {100 * definite_ / seeds / POSES:10.2f} % {with_it} "
            f"{free_:15}/{seeds} {100 * free_definite / seeds / POSES:10.2f} % {without}"
        )
    return {"seeds": seeds, "poses": POSES, "rows": rows}


def _definite(model: PhysicalModel, q: np.ndarray) -> int:
    """In how many positions M is positive-definite."""
    return int((np.linalg.eigvalsh(model.mass_matrix(q))[:, 0] > 0.0).sum())


def _without_asking(identifier: Identifier) -> PhysicalModel:
    """The most probable model, possible or not."""
    place = "bdnn_ros.physical.handover"
    with (
        patch(f"{place}.consistent", lambda mean, *_: mean.copy()),
        patch(f"{place}.feasible", lambda _: True),
    ):
        return identifier.model(0)


def forgetting(args: argparse.Namespace) -> dict[str, Any]:
    """Error on wide motion before and after 60 s of narrow motion, and the robot's own against its sensors."""
    rows = []
    for seed in range(args.seeds or 5):
        for effects in ("matched", "unmodelled"):
            one = real(seed, effects)
            others, identifier = tests(one, seed), Identifier(one.nominal)
            wide, narrow = motions(one, 2 * PIECE, seed), motions(one, 3 * PIECE, seed + 500, size=NARROW)
            found = [
                (torque_error(model, others), true_error(model, one, seed))
                for model in (identifier.fit(recordings) for recordings in (wide, narrow))
            ]
            measured, exact_ = np.transpose(found).tolist()
            itself = torque_error(Itself(one), others)
            rows.append(
                {"effects": effects, "seed": seed, "measured": measured, "exact": exact_, "itself": itself}
            )
    print(
        f"{'':17} {'against the measured effort':>30} {'along exact motion, the exact':>36} {'the robot':>13}"
    )
    print(
        f"{'effects':12} {'seed':>4} "
        + f"{'wide':>10} {'then narrow':>12} {'ratio':>6}  " * 2
        + f"{'itself':>10}"
    )
    for row in rows:
        cells = (
            f"{100 * before:8.4f} % {100 * after:10.4f} % {after / before:6.2f}  "
            for before, after in (row["measured"], row["exact"])
        )
        print(f"{row['effects']:12} {row['seed']:4} " + "".join(cells) + f"{100 * row['itself']:8.4f} %")
    return {"rows": rows}


def coverage(args: argparse.Namespace) -> dict[str, Any]:
    """How often 95 % intervals of identifiable combinations hold the truth."""
    result: dict[str, Any] = {"seeds": args.seeds or 20}
    print(f"{COVERED:g} s of motion, {result['seeds']} seeds: share of truths in their 95 % intervals")
    print(f"{'noise':10} {'bodies':>8} {'rotors':>8} {'viscous':>8} {'Coulomb':>8} {'offset':>8} {'all':>8}")
    for name in ("white", "coloured", "rough"):
        held: dict[str, list[bool]] = {}
        for seed in range(result["seeds"]):
            one = real(seed)
            model = Identifier(one.nominal).fit(_recorded(one, seed, name))
            robot, ours = one.robot, model.parameters.vector()
            truth = Parameters(
                robot.inertials, robot.armature, robot.viscous, robot.coulomb, 0.0 * robot.coulomb
            )
            before = prior(one.nominal).covariance
            for one_of in combinations(one.nominal):
                std = one_of.std(model.covariance)
                if std < IDENTIFIED * one_of.std(before):
                    off = abs(one_of.value(ours) - one_of.value(truth.vector()))
                    held.setdefault(_kind(one_of.words), []).append(off <= NORMAL * std)
        shares = {kind: float(np.mean(values)) for kind, values in held.items()}
        shares["all"] = float(np.mean([x for values in held.values() for x in values]))
        kinds = ("bodies", "rotor", "viscous", "Coulomb", "effort", "all")
        print(f"{name:10} " + " ".join(f"{100 * shares[kind]:6.1f} %" for kind in kinds))
        result[name] = shares
    return result


def _recorded(one: Real, seed: int, noise: str) -> list[Recording]:
    """Motion whose intervals are judged, with a kind of noise."""
    made = motions(one, COVERED, seed, noise == "coloured")
    return [rough(each, seed) for each in made] if noise == "rough" else made


def agreeing(args: argparse.Namespace) -> dict[str, Any]:
    """How many parameters three recordings of one unchanged robot are said to disagree on."""
    rows = []
    for effects in ("matched", "unmodelled"):
        for seed in range(args.seeds or 3):
            one = real(seed, effects)
            each = [Identifier(one.nominal).fit([r]) for r in motions(one, 3 * PIECE, seed)]
            found = agreement(each)
            differing = [a for a in found if a.differs]
            friction = sum(a.by_motion for a in differing)
            rows.append([effects, seed, len(found), friction, len(differing) - friction])
            print(
                f"{effects:12} seed {seed}: {friction} of friction and offset, {len(differing) - friction} others, "
                f"of {len(found)}"
            )
    return {"rows": rows}


def _kind(words: str) -> str:
    first = words.split()[0]
    return first if first in ("rotor", "viscous", "Coulomb", "effort") else "bodies"
