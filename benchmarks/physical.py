"""How good identification is after seconds of motion: simulated robots, real recordings, speed.

One table a group, `--only GROUP` for one of them; the numbers go to results/physical.json as well. Simulated
groups move the 7-axis robot whose URDF is 20 % wrong, with friction and rotors it does not name, noise of
5e-5 rad and 0.5 % of the effort's range at 500 Hz. All on one thread; 10 to 15 minutes in all.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

from _physical_accuracy import designed, foreign, matched, unmodelled
from _physical_recordings import from_bag, recorded
from _physical_solvers import solvers
from _physical_speed import speed
from _physical_trust import agreeing, coverage, definite, forgetting
from _results import keep

RESULTS = Path(__file__).parent / "results" / "physical.json"
GROUPS: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
    "recordings": recorded,
    "speed": speed,
    "bag": from_bag,
    "matched": matched,
    "unmodelled": unmodelled,
    "foreign": foreign,
    "designed": designed,
    "definite": definite,
    "solvers": solvers,
    "forgetting": forgetting,
    "coverage": coverage,
    "agreement": agreeing,
}


def main() -> int:
    """Run the groups, print their tables, write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=GROUPS, action="append", help="this group; repeatable")
    parser.add_argument(
        "--seeds", type=int, default=0, help="seeds of each simulated group (default: its own)"
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=Path(__file__).resolve().parents[2] / "shared" / "data",
        help="folder of the real recordings; without it they are left out",
    )
    args = parser.parse_args()
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in args.only or GROUPS:
        start = time.perf_counter()
        print(f"\n{name}: {GROUPS[name].__doc__}")
        results[name] = GROUPS[name](args)
        print(f"({time.perf_counter() - start:.0f} s)", flush=True)
    keep(RESULTS, results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
