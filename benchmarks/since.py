"""What changed since? A worn robot is identified, something about it changes, and a new recording is diagnosed against the model.

    python benchmarks/since.py    # 20 minutes

Links are 5 % off and every joint is worn: both are in the model, so only the change may be named. Every fourth robot is
unchanged. Changes are 5 to 40 % of the effort of the joint that they show in most; what is "less" was there when the robot
was identified and is gone.
"""

from __future__ import annotations

import os

from _results import keep

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import multiprocessing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _naming_judging import judge
from _naming_records import BRIEF, in_brief
from _naming_tables import NOT_DRAWN, counted
from _naming_text import text
from naming import rounded
from tqdm import tqdm

from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.errors import BdnnError
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.robot import BUNDLED, Robot
from bdnn_ros.simulation.excitation import fourier
from bdnn_ros.simulation.scenario import Scenario

RESULTS = Path(__file__).resolve().parent / "results" / "since.json"
FIRST_SEED = 140000
RATE, BEFORE, AFTER = 500.0, 60.0, 30.0
CHANGES = (
    "payload",
    "coulomb_friction",
    "viscous_friction",
    "effort_offset",
    "position_offset",
    "effort_scale",
    "backlash",
    "joint_elasticity",
    "external_wrench",
)
LESS = {"less payload": "mass", "less coulomb_friction": "coulomb", "less viscous_friction": "viscous"}
"""The parameter that is negative then."""
UNCHANGED = "nothing"
EVERY_UNCHANGED = 4


def done(seed: int) -> dict[str, Any]:
    """The record of one draw."""
    name = BUNDLED[seed % len(BUNDLED)]
    kinds = (*CHANGES, *LESS)
    change = UNCHANGED if seed % EVERY_UNCHANGED == 0 else kinds[seed // EVERY_UNCHANGED % len(kinds)]
    robot = Robot.bundled(name)
    record: dict[str, Any] = {"draw": {"seed": seed, "robot": name}, "change": change}

    def scenario(seconds: float, **options: Any) -> Scenario:
        """The same robot along another motion."""
        rng = np.random.default_rng([seed, round(seconds)])
        plan = fourier(robot, np.arange(round(seconds * RATE)) / RATE, rng)
        return Scenario(robot, seed=seed, wrong=0.05, worn=True, plan=plan, name=name, **options)

    kind = change.removeprefix("less ")
    hidden = {} if change == UNCHANGED else {"hide": 1, "hidden_names": (kind,)}
    first, then = (hidden, {}) if change in LESS else ({}, hidden)
    try:
        before, earlier = scenario(BEFORE, **first).run()
        after, truth = scenario(AFTER, **then).run()
    except BdnnError as error:
        return {**record, "status": NOT_DRAWN, "why": str(error)}
    if change in LESS:
        truth = {**truth, "effects": [_negated(effect, LESS[change]) for effect in earlier["effects"]]}
    model = Identifier(robot).fit([before.recording])
    report = examine([after.recording], model.robot, model=model).diagnosis.as_json()
    outcome = judge({**truth, "worn": None, "links": {}}, report["findings"], robot)
    return {
        **record,
        "status": "diagnosed",
        "truth": truth["effects"],
        "found": report["findings"],
        "outcome": outcome,
    }


def _negated(effect: Mapping[str, Any], parameter: str) -> dict[str, Any]:
    """A true effect as a change to the contrary."""
    values = effect["parameters"]
    return {**effect, "parameters": {**values, parameter: -values[parameter]}}


def table(records: Sequence[dict[str, Any]]) -> list[list[str]]:
    """One row a change, and one for all."""
    drawn = counted(records)
    kinds = [kind for kind in (*CHANGES, *LESS, UNCHANGED) if any(r["change"] == kind for r in drawn)]
    rows = [[kind, *in_brief([r for r in drawn if r["change"] == kind])] for kind in kinds]
    return [["changed", *BRIEF], *rows, ["all", *in_brief(drawn)]]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=72, help="default: %(default)s")
    parser.add_argument("--seed0", type=int, default=FIRST_SEED, help="default: %(default)s")
    parser.add_argument("--jobs", type=int, default=2, help="default: %(default)s")
    parser.add_argument("--results", type=Path, default=RESULTS, help="default: %(default)s")
    args = parser.parse_args()
    with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
        seeds = range(args.seed0, args.seed0 + args.draws)
        records = [rounded(r) for r in tqdm(pool.imap(done, seeds), total=args.draws, desc="robots")]
    keep(args.results, records)
    print(text(table(records)))


if __name__ == "__main__":
    main()
