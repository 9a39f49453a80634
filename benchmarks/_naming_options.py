"""Options of benchmarks that take many draws, and the run itself."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any


def seed_options(parser: argparse.ArgumentParser, draws: int, first: int) -> None:
    """Which draws are made."""
    parser.add_argument("--draws", type=int, default=draws, help="default: %(default)s")
    parser.add_argument("--seed0", type=int, default=first, help="first seed (default: %(default)s)")


def run_options(parser: argparse.ArgumentParser, results: Path, budget: float) -> None:
    """How a run is shared out, how long it may last, and where its records go."""
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: %(default)s)")
    parser.add_argument(
        "--budget",
        metavar="SECONDS",
        type=float,
        default=budget,
        help="begin no draw after so long, 0 for no limit (default: %(default)s)",
    )
    parser.add_argument(
        "--results", type=Path, default=results, help=f"default: {results.parent.name}/{results.name}"
    )


def run(
    done: Callable[[float, int], list[dict[str, Any]]], args: argparse.Namespace, code: str
) -> list[dict[str, Any]]:
    """Records of draws, each draw's kept as soon as it is done.

    Args:
        done: the records of a draw by its seed; none after a deadline [s of the monotonic clock].
        args: of `seed_options` and `run_options`.
        code: tells the sources that made them.
    """
    args.results.parent.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + args.budget if args.budget > 0.0 else float("inf")
    seeds = range(args.seed0, args.seed0 + args.draws)
    records: list[dict[str, Any]] = []
    try:
        with (
            multiprocessing.get_context("spawn").Pool(args.jobs) as pool,
            args.results.open("a", encoding="utf-8") as file,
        ):
            for some in pool.imap(partial(done, deadline), seeds):
                for record in some:
                    records.append(record | {"code": code})
                    file.write(json.dumps(records[-1]) + "\n")
                file.flush()
                print(f"{len(records)} diagnoses", file=sys.stderr)
    except KeyboardInterrupt:
        print("stopped; finished draws are kept", file=sys.stderr)
    return records
