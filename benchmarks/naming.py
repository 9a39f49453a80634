"""Naming hidden effects, blind: draw, simulate, write a bag without the truth, diagnose it, then compare.

Every finished draw is appended to results/naming.jsonl at once, so that nothing is lost when it is stopped.
Seeds from 10000 on. Draws that were looked at and led to a change do not measure it: measure with a --seed0 not used yet.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import ast
import hashlib
import json
import multiprocessing
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import islice
from pathlib import Path
from typing import Any

import _naming_document as document
from _naming_draws import Choices, Draw, done
from _naming_options import run_options, seed_options
from _naming_recordings import RECORDED, in_words, recorded, tables
from _naming_robots import EXAMPLES
from _naming_tables import by_condition, by_effect, confusion, counted, shows, summary
from _naming_text import text
from _results import keep

from bdnn_ros.effects.registry import EFFECTS

HERE = Path(__file__).resolve().parent
RECORDS = HERE / "results" / "naming.jsonl"
SOURCES = (
    *("diagnosis", "effects", "simulation", "signals", "recording.py", "robot"),
    *("checks/alternatives.py", "checks/conventions.py", "checks/positions.py", "checks/sampling.py"),
)
FIRST_SEED, BUDGET = 10000, 120.0


def main() -> None:
    args = _arguments()
    if args.write_docs:
        document.write(args.results, fingerprint())
        return
    if args.recordings:
        tell_recordings(args.recordings)
        return
    records: list[dict[str, Any]] = []
    try:
        for record in run((choices(args).draw(s) for s in range(args.seed0, args.seed0 + args.draws)), args):
            records.append(record)
    except KeyboardInterrupt:
        print("stopped; finished draws are kept", file=sys.stderr)
    drawn = counted(records)
    keep(args.results.with_suffix(".json"), summary(drawn))
    if args.json:
        print(json.dumps({"summary": summary(drawn), "records": records}))
        return
    tell(records, args.draws)


def _without_results(words: Sequence[str]) -> list[str]:
    """The words of a command line but for where its results go."""
    return [
        word
        for before, word in zip(["", *words], words, strict=False)
        if before != "--results" and not word.startswith("--results")
    ]


def run(draws: Iterable[Draw], args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Finished draws, until none is left or the budget is spent; each is appended to the results first."""
    deadline = time.monotonic() + args.budget if args.budget > 0.0 else float("inf")
    code, command = fingerprint(), "python benchmarks/naming.py " + " ".join(_without_results(sys.argv[1:]))
    args.results.parent.mkdir(parents=True, exist_ok=True)
    with args.results.open("a", encoding="utf-8") as file:
        for record in _finished(iter(draws), args.jobs, deadline):
            record |= {"code": code, "command": command.strip()}
            file.write(json.dumps(rounded(record)) + "\n")
            file.flush()
            if not args.json:
                print(line(record), flush=True)
            yield record


def tell(records: Sequence[Mapping[str, Any]], wanted: int) -> None:
    """All tables on the terminal."""
    drawn = counted(records)
    print(f"\n{len(records)} of {wanted} draws done, {len(records) - len(drawn)} of them could not be drawn")
    if drawn:
        for rows in (confusion(drawn), by_effect(drawn), by_condition(drawn), shows(drawn)):
            print(f"\n{text(rows)}")
    for record in drawn:
        if record["status"] == "crashed":
            print(f"\ncrashed: seed {record['draw']['seed']}\n{record['why']}")


def line(record: Mapping[str, Any]) -> str:
    """One draw in words."""
    draw = record["draw"]
    conditions = [str(draw["robot"]), f"{draw['duration']:.0f} s", f"{100 * draw['wrong']:.0f} % off"]
    conditions += [word for word in ("worn", "coloured", "poor") if draw[word]]
    start = f"{draw['seed']} {', '.join(conditions)}: "
    if record["status"] != "diagnosed":
        return start + f"{record['status']}: {str(record['why']).strip().splitlines()[-1]}"
    floor = f"{record['over_floor']:.2f} floors, {record['cpu_seconds']:.1f} s"
    return start + "; ".join([*said(record["outcome"]), floor])


def said(outcome: Mapping[str, Any]) -> list[str]:
    """What a diagnosis made of what was hidden, in words, and what it named falsely."""
    hidden = [f"{o['effect']} {'named' if o['named'] else '-> ' + o['as']}" for o in outcome["hidden"]]
    false = [f"false: {', '.join(outcome['false'])}"] if outcome["false"] else []
    return [*(hidden or ["nothing hidden"]), *false]


def tell_recordings(data: Path) -> None:
    """Diagnoses real recordings and their halves; keeps and prints what they name."""
    results = recorded(data)
    keep(RECORDED, rounded(results))
    for title, rows in tables(results):
        print(f"\n{title}\n{text(rows)}")
    print("\n" + in_words(results))


def fingerprint() -> str:
    """Tells the sources apart that results were made by, by what they do: not by comments, docstrings and layout."""
    root, digest = HERE.parent / "bdnn_ros", hashlib.sha256()
    for source in SOURCES:
        path = root / source
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(_meaning(file.read_text(encoding="utf-8")).encode())
    return digest.hexdigest()[:12]


def _meaning(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(body := getattr(node, "body", None), list):
            texts = (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) for one in body)
            node.body = [one for one, text in zip(body, texts, strict=True) if not text]
    return ast.dump(tree)


def rounded(value: Any) -> Any:
    """Numbers with five significant digits."""
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, Mapping):
        return {key: rounded(inner) for key, inner in value.items()}
    return [rounded(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def choices(args: argparse.Namespace) -> Choices:
    """What the command line fixes."""
    return Choices(
        robots=tuple(args.robots),
        effects=tuple(args.effects),
        hidden=args.hidden,
        wrong=args.wrong,
        worn=None if args.worn is None else args.worn == "yes",
        coloured=None if args.noise is None else args.noise == "coloured",
        duration=args.duration,
        poor=None if args.excitation is None else args.excitation == "poor",
    )


def _finished(draws: Iterator[Draw], jobs: int, deadline: float) -> Iterator[dict[str, Any]]:
    """Records as they are done; nothing new is begun after the deadline."""
    if jobs == 1:
        for draw in draws:
            if time.monotonic() >= deadline:
                return
            yield done(draw)
        return
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        running: set[Future[dict[str, Any]]] = {pool.submit(done, draw) for draw in islice(draws, jobs)}
        while running:
            ready, running = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                yield future.result()
            if time.monotonic() < deadline:
                running |= {pool.submit(done, draw) for draw in islice(draws, len(ready))}


def _arguments() -> argparse.Namespace:
    def names(words: str) -> list[str]:
        return [word for word in words.split(",") if word]

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    seed_options(parser, 300, FIRST_SEED)
    parser.add_argument(
        "--robots",
        type=names,
        default=["arm2", "arm6", "arm7"],
        help=f"bundled robots, {', '.join(EXAMPLES)} of example-robot-data, or URDF files, a,b",
    )
    parser.add_argument("--effects", type=names, default=list(EFFECTS), help="effects to hide, a,b")
    parser.add_argument("--hidden", type=int, choices=(0, 1, 2, 3), help="how many (default: by the seed)")
    parser.add_argument("--worn", choices=("yes", "no"), help="default: by the seed")
    parser.add_argument("--wrong", type=float, help="share that links are off by (default: by the seed)")
    parser.add_argument("--noise", choices=("white", "coloured"), help="default: by the seed")
    parser.add_argument("--duration", type=float, help="seconds of motion (default: by the seed)")
    parser.add_argument("--excitation", choices=("rich", "poor"), help="default: by the seed")
    run_options(parser, RECORDS, BUDGET)
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    parser.add_argument("--write-docs", action="store_true", help="write docs/naming.md from the results")
    parser.add_argument("--recordings", metavar="DIR", type=Path, help="diagnose real recordings instead")
    args = parser.parse_args()
    unknown = [name for name in args.effects if name not in EFFECTS]
    if unknown:
        parser.error(f"no effect {', '.join(unknown)}; there are {', '.join(EFFECTS)}")
    return args


if __name__ == "__main__":
    main()
