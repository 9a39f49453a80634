"""Options of benchmarks that take many draws."""

from __future__ import annotations

import argparse
from pathlib import Path


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
