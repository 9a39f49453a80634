"""Naming hidden effects in recordings that were read badly: each draw is diagnosed as recorded, and in every other way.

    python benchmarks/naming_readings.py --budget 0 --jobs 2    # 10 minutes

What is hidden is the same in every way; a way costs what it names less, and what it names falsely. A filter of the reported
velocity is not hidden, since some ways leave no such velocity.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from dataclasses import asdict
from typing import Any

import numpy as np
from _naming_draws import Choices, scenario
from _naming_judging import judge
from _naming_options import run, run_options, seed_options
from _naming_readings import RECORDS, WAYS, table
from _naming_robots import robot_of
from _naming_tables import NOT_DRAWN
from _naming_text import text
from naming import fingerprint, rounded

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.effects.registry import EFFECTS
from bdnn_ros.errors import BdnnError

FIRST_SEED, BUDGET = 124000, 120.0
HIDDEN = tuple(name for name in EFFECTS if name != "velocity_filter")


def main() -> None:
    args = _arguments()
    records = run(done, args, fingerprint())
    if records:
        print(text(table(records)))


def done(deadline: float, seed: int) -> list[dict[str, Any]]:
    """The records of one draw, one for each way; none after the deadline or where it could not be drawn."""
    if time.monotonic() > deadline:
        return []
    draw = Choices(effects=HIDDEN, hidden=1, wrong=0.05, duration=30.0, poor=False).draw(seed)
    try:
        simulated, truth = scenario(draw).run()
    except BdnnError as error:
        return [{"draw": asdict(draw), "way": way, "status": NOT_DRAWN, "why": str(error)} for way in WAYS]
    robot, records = robot_of(draw.robot), []
    for way, misread in WAYS.items():
        record: dict[str, Any] = {"draw": asdict(draw), "way": way, "truth": truth["effects"]}
        start = time.process_time()
        try:
            report = diagnose([misread(simulated.recording, np.random.default_rng(seed))], robot).as_json()
        except BdnnError as error:
            records.append({**record, "status": "refused", "why": str(error)})
            continue
        outcome = judge(truth, report["findings"], robot)
        seconds = round(time.process_time() - start, 2)
        records.append(rounded({**record, "status": "diagnosed", "outcome": outcome, "cpu_seconds": seconds}))
    return records


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    seed_options(parser, len(HIDDEN), FIRST_SEED)
    run_options(parser, RECORDS, BUDGET)
    return parser.parse_args()


if __name__ == "__main__":
    main()
