"""Groups of physical.py: how far off a model is after seconds of motion."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from _physical_data import RATE, Real, motions, real, sensed, tests
from _physical_measures import (
    exact,
    first_seconds,
    gravity_std,
    mechanics_errors,
    rollout,
    torque_error,
    true_error,
    true_rollout,
)

from bdnn_ros.excitation.choice import excite
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.recording import Recording

Pieces = dict[float, list[Recording]]
"""Recordings by how many seconds of motion they hold."""

SEEDS = {"matched": 7, "unmodelled": 3, "foreign": 3}
SECONDS = (1.0, 2.0, 5.0, 10.0, 30.0, 120.0)
DESIGNED = (5.0, 10.0, 30.0)
"""Seconds of motions that are made for identification."""


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
