"""Ours beside its peers: effort, its parts, and rollouts, on three robots; two tables.

By default one seed at a quarter of the time, which takes about 8 minutes on an idle core. The tables of
docs/theory.md are of full time, an hour for three seeds:

    python benchmarks/bdnn.py --seeds 3 --budget-scale 1 --resume

Each result is saved at once, so an interrupted run goes on with --resume. Budgets are processor seconds of one
thread; methods that are given the axes get 30 s of motion and 30 s of time, all others much more.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from _bdnn_judging import judge
from _bdnn_methods import GROUPS, METHODS, MOTION
from _motion import Data, data

from bdnn_ros.written import whole

RESULTS = Path(__file__).parent / "results" / "bdnn.json"
THEORY = Path(__file__).parents[1] / "docs" / "theory.md"
MARKS = "<!-- tables: python benchmarks/bdnn.py --write-docs -->", "<!-- end of tables -->"
DOCUMENTED_SCALE = 1.0
PICTURES = Path(__file__).parents[1] / "docs" / "images"
COLUMNS = {
    "nmse": ("effort nMSE %", 100.0),
    "mass": ("M %", 100.0),
    "gravity": ("g %", 100.0),
    "coriolis": ("C q̇ %", 100.0),
    "rollout_0.1": ("0.1 s [mrad]", 1000.0),
    "rollout_1": ("1 s [mrad]", 1000.0),
    "seconds": ("train [s]", 1.0),
    "motion": ("motion [s]", 1.0),
}
"""Heading and factor of each column of the table."""
MECHANICS = {
    "friction": ("friction %", 100.0),
    "kinetic": ("kinetic energy %", 100.0),
    "potential": ("potential energy %", 100.0),
    "least_eigenvalue": ("least eigenvalue of M / true", 1.0),
    "passive": ("friction passive %", 100.0),
    "gravity_curl": ("curl of g %", 100.0),
}
"""The same for the second table: further parts, and whether it could be a machine."""
Cell = dict[str, Any]


def key(cell: Cell) -> tuple[str, str, int, float]:
    """What a cell is the result of."""
    return cell["robot"], cell["method"], cell["seed"], cell["scale"]


def measured(robot: str, method: str, seed: int, scale: float, given: Data) -> Cell:
    """One method on one robot with one seed."""
    way = METHODS[method]
    start = time.process_time()
    model = way.learn(given, scale * way.budget(robot), seed)
    seconds = time.process_time() - start
    errors = {
        name: None if value is None else float(f"{value:.4g}") for name, value in judge(model, given).items()
    }
    return {
        "robot": robot,
        "method": method,
        "seed": seed,
        "scale": scale,
        "budget": scale * way.budget(robot),
        "seconds": round(seconds, 1),
        "motion": given.seconds,
        **errors,
    }


def table(
    cells: Sequence[Cell],
    scale: float,
    columns: Mapping[str, tuple[str, float]] = COLUMNS,
    markdown: bool = False,
) -> str:
    """Median and range over the seeds of every robot and method measured at a scale of the budgets."""
    head = ["robot", "method", "seeds", *(heading for heading, _ in columns.values())]
    rows = []
    for robot in MOTION:
        for method, way in METHODS.items():
            group = [c for c in cells if (c["robot"], c["method"], c["scale"]) == (robot, method, scale)]
            if group:
                numbers = [spread([c[name] for c in group], factor) for name, (_, factor) in columns.items()]
                rows.append([robot, way.label, str(len(group)), *numbers])
    if markdown:
        lines = [head, ["---"] * len(head), *rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)
    widths = [max(len(line[k]) for line in [head, *rows]) for k in range(len(head))]
    return "\n".join(
        "  ".join(t.ljust(w) for t, w in zip(line, widths, strict=True)) for line in [head, *rows]
    )


def spread(values: Sequence[float | None], factor: float) -> str:
    """Median, and the range where there is one; a rollout that ran away counts as infinite."""
    sizes = np.array([np.inf if value is None else factor * value for value in values])
    middle, low, high = (number(x) for x in (np.median(sizes), sizes.min(), sizes.max()))
    return middle if low == high else f"{middle} ({low}–{high})"


def number(value: float) -> str:
    """Two significant digits, without an exponent unless it is absurd."""
    if not np.isfinite(value):
        return "ran away"
    if 0.0 < value < 1e-3:
        return "<0.001"
    if abs(value) >= 1e6:
        return f"{value:.0e}"
    return f"{value:.0f}" if abs(value) >= 9.95 else f"{float(f'{value:.2g}'):.12g}"


def load(path: Path) -> list[Cell]:
    """Cells measured before."""
    return list(json.loads(path.read_text())["cells"]) if path.exists() else []


def save(path: Path, cells: Sequence[Cell]) -> None:
    """Write all cells, in order."""
    path.parent.mkdir(exist_ok=True)
    order = {name: k for k, name in enumerate([*MOTION, *METHODS])}
    ordered = sorted(cells, key=lambda c: (c["scale"], order[c["robot"]], order[c["method"]], c["seed"]))
    lines = ",\n".join("  " + json.dumps(cell) for cell in ordered)
    with whole(path) as beside:
        beside.write_text(f'{{"format": "bdnn_ros/benchmark-bdnn", "cells": [\n{lines}\n]}}\n')


def run(args: argparse.Namespace) -> list[Cell]:
    """Measure every cell asked for; what is there already stays with --resume."""
    cells = load(args.results)
    there = {key(cell) for cell in cells} if args.resume else set()
    for seed in range(args.first_seed, args.first_seed + args.seeds):
        for robot in args.robots:
            held: dict[float, Data] = {}
            for method in args.methods:
                if (robot, method, seed, args.budget_scale) in there:
                    continue
                seconds = METHODS[method].motion(robot)
                if seconds not in held:
                    held[seconds] = data(robot, seconds, seed)
                cell = measured(robot, method, seed, args.budget_scale, held[seconds])
                cells = [*(c for c in cells if key(c) != key(cell)), cell]
                save(args.results, cells)
                said = f"{robot} seed {seed} {METHODS[method].label}: nMSE {100.0 * cell['nmse']:.3g} %"
                print(f"{said}, {cell['seconds']:.0f} s", file=sys.stderr, flush=True)
    return cells


def documented(theory: str, cells: Sequence[Cell]) -> str:
    """The text of docs/theory.md with the tables of these results."""
    before, _, rest = theory.partition(MARKS[0])
    after = rest.partition(MARKS[1])[2]
    tables = "\n\n".join(table(cells, DOCUMENTED_SCALE, c, markdown=True) for c in (COLUMNS, MECHANICS))
    return f"{before}{MARKS[0]}\n\n{tables}\n\n{MARKS[1]}{after}"


def pictures(robots: Sequence[str], scale: float) -> None:
    """Train ours on each robot and draw what was learned beside the truth."""
    from _bdnn_pictures import draw, learned

    PICTURES.mkdir(exist_ok=True)
    for robot in robots:
        given = data(robot, MOTION[robot], 0)
        path = PICTURES / f"theory_{robot}.png"
        draw(path, given, learned(given, robot, scale))
        print(path.relative_to(PICTURES.parents[1]))


def arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """The command line."""

    def names(text: str) -> list[str]:
        return [word for word in text.split(",") if word]

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robots", type=names, default=list(MOTION), help="default: arm2,arm6,arm7")
    parser.add_argument(
        "--methods", type=names, default=["all"], help=f"of {', '.join([*METHODS, *GROUPS])} (default: all)"
    )
    parser.add_argument("--seeds", type=int, default=1, help="how many (default: %(default)s)")
    parser.add_argument("--first-seed", type=int, default=0, help="default: %(default)s")
    parser.add_argument(
        "--budget-scale", type=float, default=0.25, help="factor on all budgets (default: %(default)s)"
    )
    parser.add_argument("--resume", action="store_true", help="keep what was measured before")
    parser.add_argument("--table", action="store_true", help="measure nothing, print what there is")
    parser.add_argument(
        "--pictures", action="store_true", help="draw docs/images/theory_*.png instead of the table"
    )
    parser.add_argument(
        "--write-docs", action="store_true", help="write the tables of docs/theory.md from the results"
    )
    parser.add_argument("--results", type=Path, default=RESULTS, help="default: results/bdnn.json")
    args = parser.parse_args(words)
    args.methods = [method for word in args.methods for method in GROUPS.get(word, [word])]
    for given, known in ((args.robots, list(MOTION)), (args.methods, list(METHODS))):
        unknown = [name for name in given if name not in known]
        if unknown:
            parser.error(f"no {', '.join(unknown)}; there are {', '.join(known)}")
    if not args.budget_scale > 0.0:
        parser.error("a budget needs some time")
    return args


def main() -> None:
    args = arguments()
    torch.set_num_threads(1)
    if args.pictures:
        pictures(args.robots, args.budget_scale)
        return
    cells = load(args.results) if args.table or args.write_docs else run(args)
    if args.write_docs:
        THEORY.write_text(documented(THEORY.read_text(), cells))
        return
    for columns in (COLUMNS, MECHANICS):
        print(table(cells, args.budget_scale, columns), end="\n\n")


if __name__ == "__main__":
    main()
