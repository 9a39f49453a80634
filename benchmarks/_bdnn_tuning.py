"""Chooses width, rate and batch of the peers: by the held-out effort error on motions of a seed not reported.

One thing is varied at a time, the best is kept. Ours were chosen in the same way. About 12 minutes.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch
from _bdnn_effort import PERCEPTRON, perceptron
from _bdnn_lagrangian import LAGRANGIAN, lagrangian
from _bdnn_methods import BUDGET, MOTION
from _bdnn_ode import ODE, neural_ode
from _motion import data

from bdnn_ros.scores import score_model

SEED = 100
SHARE = 1.0 / 3.0
"""Of the time a peer has in the benchmark."""
CHOICES: dict[str, dict[str, tuple[Any, ...]]] = {
    "arm2": {"hidden": (16, 32, 64)},
    "arm6": {"rate": (1e-3, 2e-3, 5e-3, 1e-2, 2e-2), "batch": (256, 1024), "hidden": (64, 128, 256)},
}


def main() -> None:
    torch.set_num_threads(1)
    for robot, choices in CHOICES.items():
        given = data(robot, MOTION[robot], SEED)
        small = given.truth.width <= 3
        for name, learn, settings in (
            ("DeLaN-type", lagrangian, LAGRANGIAN),
            ("inverse-dynamics MLP", perceptron, PERCEPTRON),
            ("neural ODE", neural_ode, ODE),
        ):
            best, tried = settings[small], {}
            for what, values in choices.items():
                for value in values:
                    trial = replace(best, **{what: value})
                    if trial not in tried:
                        model = learn(given, SHARE * BUDGET[robot], SEED, trial)
                        tried[trial] = float(score_model(model, given.validation).nmse.mean())
                        print(f"{robot} {name} {trial}: nMSE {100.0 * tried[trial]:.3g} %", flush=True)
                best = min(tried, key=tried.__getitem__)
            print(f"{robot} {name}: {best}", flush=True)


if __name__ == "__main__":
    main()
