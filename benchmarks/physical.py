"""How good identification is after seconds of motion: simulated robots, real recordings, speed.

One table a group, `--only GROUP` for one of them; the numbers go to results/physical.json as well. Simulated
groups move the 7-axis robot whose URDF is 20 % wrong, with friction and rotors it does not name, noise of
5e-5 rad and 0.5 % of the effort's range at 500 Hz. All on one thread; 10 to 15 minutes in all.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from _physical_data import EFFECTS, PIECE, RATE, Real, motions, real, sensed, tests
from _physical_measures import (
    Itself,
    exact,
    first_seconds,
    gravity_std,
    mechanics_errors,
    poses,
    rollout,
    torque_error,
    true_error,
    true_rollout,
)
from _physical_recordings import from_bag, recorded
from _physical_solvers import solvers
from _physical_speed import speed

from bdnn_ros.excitation.choice import excite
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.agreement import agreement
from bdnn_ros.physical.combinations import combinations
from bdnn_ros.physical.consistency import feasible
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Parameters, prior
from bdnn_ros.recording import Recording

Pieces = dict[float, list[Recording]]
"""Recordings by how many seconds of motion they hold."""

RESULTS = Path(__file__).parent / "results" / "physical.json"
SEEDS = {"matched": 7, "unmodelled": 3, "foreign": 3}
SECONDS = (1.0, 2.0, 5.0, 10.0, 30.0, 120.0)
EARLY = (1.0, 2.0, 5.0, 10.0)
DESIGNED = (5.0, 10.0, 30.0)
"""Seconds of motions that are made for identification."""
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


def errors(
    args: argparse.Namespace, effects: str, pieces: Callable[[Real, int], Pieces] | None = None
) -> dict[str, Any]:
    """Torque, M, g and rollout after seconds of motion.

    Args:
        pieces: recordings of so many seconds each; None takes the first seconds of random motions.
    """
    rows: dict[float, list[list[float]]] = {}
    floors = []
    for seed in range(args.seeds or SEEDS[effects]):
        one = real(seed, effects)
        others = tests(one, seed)
        for seconds, recordings in (pieces or _random)(one, seed).items():
            model = Identifier(one.nominal).fit(recordings)
            row = [torque_error(model, others), *mechanics_errors(model, one), rollout(model, others[0])]
            row += [true_error(model, one, seed), gravity_std(model, one), true_rollout(model, one, seed)]
            rows.setdefault(seconds, []).append(row)
        true = exact(model, one)
        floor = [
            torque_error(true, others),
            0.0,
            0.0,
            rollout(true, others[0]),
            true_error(true, one, seed),
            0.0,
        ]
        floors.append([*floor, true_rollout(true, one, seed)])
    print(
        "torque nMSE against the measured effort, and along exact motion against the exact effort; rollouts alike"
    )
    print(
        f"{'motion':>12} {'measured':>12} {'(worst seed)':>13} {'exact':>12} {'M off by':>9} {'g off by':>9} "
        f"{'(its std)':>9} "
        f"{'1 s rollout':>12} {'exact':>12}"
    )
    for label, found in [*((f"{s:g} s", v) for s, v in rows.items()), ("true bodies", floors)]:
        mean, worst = np.mean(found, axis=0), np.max(found, axis=0)
        print(
            f"{label:>12} {100 * mean[0]:10.4f} % {100 * worst[0]:11.4f} % {100 * mean[4]:10.4f} % "
            f"{100 * mean[1]:7.2f} % "
            f"{100 * mean[2]:7.2f} % {100 * mean[5]:7.2f} % {mean[3]:8.4f} rad {mean[6]:8.4f} rad"
        )
    keys = ("nmse", "mass_matrix", "gravity", "rollout_rad", "nmse_exact", "gravity_std", "rollout_exact_rad")
    return {
        "seconds": {
            f"{s:g}": dict(zip(keys, np.transpose(v).tolist(), strict=True)) for s, v in rows.items()
        },
        "true_bodies": dict(zip(keys, np.transpose(floors).tolist(), strict=True)),
    }


def _random(one: Real, seed: int) -> Pieces:
    recordings = motions(one, SECONDS[-1], seed)
    return {seconds: first_seconds(recordings, seconds) for seconds in SECONDS}


def _designed(one: Real, seed: int) -> Pieces:
    """Recordings of what `bdnn excite` makes of the wrong description."""
    rng = np.random.default_rng([seed, 4])
    plans = {s: excite(one.nominal, duration=s, rate=RATE, seed=seed).trajectory for s in DESIGNED}
    return {seconds: [sensed(one, plan, rng)] for seconds, plan in plans.items()}


def designed(args: argparse.Namespace) -> dict[str, Any]:
    """Matched friction, with the motion of `bdnn excite` in place of a random one."""
    return errors(args, "matched", _designed)


def matched(args: argparse.Namespace) -> dict[str, Any]:
    """Friction that the parameters describe: Coulomb and viscous."""
    return errors(args, "matched")


def unmodelled(args: argparse.Namespace) -> dict[str, Any]:
    """Stribeck and load-dependent friction, quadratic drag and cogging on every joint as well."""
    return errors(args, "unmodelled")


def foreign(args: argparse.Namespace) -> dict[str, Any]:
    """Effects that no input was made for: a bump at a position, an effort by the next joint's position."""
    return errors(args, "foreign")


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
    for coloured in (False, True):
        held: dict[str, list[bool]] = {}
        for seed in range(result["seeds"]):
            one = real(seed)
            model = Identifier(one.nominal).fit(motions(one, COVERED, seed, coloured))
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
        name = "coloured" if coloured else "white"
        kinds = ("bodies", "rotor", "viscous", "Coulomb", "effort", "all")
        print(f"{name:10} " + " ".join(f"{100 * shares[kind]:6.1f} %" for kind in kinds))
        result[name] = shares
    return result


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


GROUPS: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
    "recordings": recorded,
    "speed": speed,
    "bag": from_bag,
    **{name: globals()[name] for name in EFFECTS},
    "designed": designed,
    "definite": definite,
    "solvers": solvers,
    "forgetting": forgetting,
    "coverage": coverage,
    "agreement": agreeing,
}


def main() -> int:
    """Run the groups, print their tables, write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=GROUPS, action="append", help="this group; repeatable")
    parser.add_argument(
        "--seeds", type=int, default=0, help="seeds of each simulated group (default: its own)"
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=Path(__file__).resolve().parents[2] / "shared" / "data",
        help="folder of the real recordings; without it they are left out",
    )
    args = parser.parse_args()
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in args.only or GROUPS:
        start = time.perf_counter()
        print(f"\n{name}: {GROUPS[name].__doc__}")
        results[name] = GROUPS[name](args)
        print(f"({time.perf_counter() - start:.0f} s)", flush=True)
    RESULTS.parent.mkdir(exist_ok=True)
    beside = RESULTS.with_suffix(".tmp")
    beside.write_text(json.dumps(results, indent=1) + "\n")
    os.replace(beside, RESULTS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
