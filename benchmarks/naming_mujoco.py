"""Naming causes hidden in MuJoCo's robots: another simulator's joints, integrator and friction.

Every finished draw is appended to results/naming_mujoco.jsonl at once, those of other motions to naming_motions.jsonl, of
other robots to naming_strangers.jsonl;
docs/naming.md shows what they add up to.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from _naming_judging import judge
from _naming_motions import MOTIONS
from _naming_mujoco import ROBOTS, drawn, made
from _naming_options import run_options, seed_options
from _naming_robots import EXAMPLES, bare
from _naming_simulator import OF_MOTIONS, OF_STRANGERS, RECORDS, in_words, table
from _naming_tables import NOT_DRAWN, counted
from _naming_text import text
from naming import fingerprint, rounded, said

from bdnn_ros import bags
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.errors import BdnnError

FIRST_SEED, DRAWS, BUDGET = 20000, 69, 120.0


def main() -> None:
    args = _arguments()
    args.results.parent.mkdir(parents=True, exist_ok=True)
    records = []
    try:
        with args.results.open("a", encoding="utf-8") as file:
            for record in _finished(args):
                records.append(rounded(record | {"code": fingerprint()}))
                file.write(json.dumps(records[-1]) + "\n")
                file.flush()
                print(_line(record), flush=True)
    except KeyboardInterrupt:
        print("stopped; finished draws are kept", file=sys.stderr)
    if records := counted(records):
        print(f"\n{in_words(records)}\n\n{text(table(records))}")


def done(deadline: float, motion: str, robots: Sequence[str], seed: int) -> dict[str, Any] | None:
    """The record of a draw: moved by MuJoCo, written as a bag, diagnosed from the bag; None after the deadline."""
    if time.monotonic() > deadline:
        return None
    draw = drawn(seed, motion, robots)
    try:
        recording, truth = made(draw)
    except BdnnError as error:
        return {"draw": asdict(draw), "truth": [], "status": NOT_DRAWN, "why": str(error)}
    record: dict[str, Any] = {"draw": asdict(draw), "truth": truth["effects"]}
    start = time.process_time()
    with tempfile.TemporaryDirectory(prefix="naming") as folder:
        bag = bags.write(recording, Path(folder) / "bag")
        try:
            report = diagnose([bags.read(bag)], bare(draw.robot)).as_json()
        except BdnnError as error:
            return {**record, "status": "refused", "why": str(error)}
    outcome = judge(truth, report["findings"], bare(draw.robot))
    seconds = round(time.process_time() - start, 2)
    return {
        **record,
        "status": "diagnosed",
        "cpu_seconds": seconds,
        "verdict": report["verdict"],
        "outcome": outcome,
    }


def _finished(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    deadline = time.monotonic() + args.budget if args.budget > 0.0 else float("inf")
    seeds = range(args.seed0, args.seed0 + args.draws)
    if args.jobs == 1:
        records = map(partial(done, deadline, args.motion, args.robots), seeds)
        yield from (record for record in records if record is not None)
        return
    with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
        for record in pool.imap(partial(done, deadline, args.motion, args.robots), seeds):
            if record is not None:
                yield record


def _line(record: dict[str, Any]) -> str:
    """One draw in words."""
    draw = record["draw"]
    start = f"{draw['seed']} {draw['robot']}{', worn' if draw['worn'] else ''}, {draw['rate']} Hz: "
    if record["status"] != "diagnosed":
        return f"{start}{record['status']}: {record['why']}"
    return start + "; ".join([*said(record["outcome"]), f"{record['cpu_seconds']:.1f} s"])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    seed_options(parser, DRAWS, FIRST_SEED)
    parser.add_argument("--motion", choices=list(MOTIONS), default="fourier", help="default: %(default)s")
    parser.add_argument(
        "--robots",
        type=lambda names: tuple(names.split(",")),
        default=ROBOTS,
        help=f"a,b of {', '.join(ROBOTS)} (default: these), {', '.join(EXAMPLES)}",
    )
    run_options(parser, RECORDS, BUDGET)
    args = parser.parse_args()
    if unknown := set(args.robots) - {*ROBOTS, *EXAMPLES}:
        parser.error(f"no robot {', '.join(sorted(unknown))}")
    if args.results == RECORDS and args.motion != "fourier":
        args.results = OF_MOTIONS
    if args.results == RECORDS and set(args.robots) & set(EXAMPLES):
        args.results = OF_STRANGERS
    return args


if __name__ == "__main__":
    main()
