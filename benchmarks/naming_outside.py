"""What is said of causes that the library does not hold: what they depend on, without a false name.

python benchmarks/naming_outside.py --budget 0 --jobs 2    # 6 minutes
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from dataclasses import asdict
from typing import Any

from _naming_draws import Choices, scenario
from _naming_options import run, run_options, seed_options
from _naming_outside import CAUSES, RECORDS, hiding, judged, table
from _naming_robots import robot_of
from _naming_tables import NOT_DRAWN
from _naming_text import text
from naming import fingerprint

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.errors import BdnnError

FIRST_SEED, BUDGET = 310000, 120.0


def main() -> None:
    args = _arguments()
    records = run(done, args, fingerprint())
    if records:
        print(text(table(records)))


def done(deadline: float, seed: int) -> list[dict[str, Any]]:
    """The record of one draw, none after the deadline. Causes take turns, and so do new and worn robots."""
    if time.monotonic() > deadline:
        return []
    worn = bool(seed // len(CAUSES) % 2)
    draw = Choices(hidden=0, wrong=0.05, worn=worn, duration=30.0, poor=False).draw(seed)
    record: dict[str, Any] = {"draw": asdict(draw)}
    try:
        simulated, _ = scenario(draw).run()
    except BdnnError as error:
        return [{**record, "status": NOT_DRAWN, "why": str(error)}]
    recording, truth = hiding(simulated, [*CAUSES][seed % len(CAUSES)], seed)
    start = time.process_time()
    report = diagnose([recording], robot_of(draw.robot)).as_json()
    seconds = round(time.process_time() - start, 2)
    outcome = judged(truth, report, worn)
    return [{**record, "status": "diagnosed", "truth": truth, "outcome": outcome, "cpu_seconds": seconds}]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    seed_options(parser, 4 * len(CAUSES), FIRST_SEED)
    run_options(parser, RECORDS, BUDGET)
    return parser.parse_args()


if __name__ == "__main__":
    main()
