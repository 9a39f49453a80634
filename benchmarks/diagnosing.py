"""How long `bdnn diagnose` takes, from a bag of 40 s at 500 Hz with seven joints to its report.

    python benchmarks/diagnosing.py                # every case, 3 to 5 minutes
    python benchmarks/diagnosing.py --seeds 5      # more recordings of each case

Wall time of the whole command, as a user waits for it: start of Python, reading, diagnosis, files and report.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from itertools import count, islice
from pathlib import Path

import numpy as np
from _results import keep

RESULTS = Path(__file__).parent / "results" / "diagnosing.json"
WANTED = 30.0
"""A diagnosis must take no longer [s]."""
PUSH = "external_wrench@arm7_link5:start=12,end=19,force_x=12,force_y=-9,force_z=7"
CASES = {
    "nothing hidden": (),
    "one effect": ("--hide", "1"),
    "two effects": ("--hide", "2"),
    "a tilted base": ("--effect", "base_tilt:roll_deg=3,pitch_deg=-2"),
    "a push": ("--effect", PUSH),
    "worn": ("--worn",),
    "worn and one effect": ("--worn", "--hide", "1"),
    "worn and a push": ("--worn", "--effect", PUSH),
}
"""What is asked of `bdnn simulate` beside 40 s at 500 Hz of links 5 % off."""


def main() -> None:
    parser = argparse.ArgumentParser(description="How long a diagnosis takes.")
    parser.add_argument("--seeds", type=int, default=2, help="recordings of each case (default: 2)")
    parser.add_argument("--seed0", type=int, default=0, help="the first seed (default: 0)")
    args = parser.parse_args()
    print(f"Seconds from a bag (seven joints, 40 s, 500 Hz) to its report, {os.cpu_count()} cores")
    rows = {}
    for case, words in CASES.items():
        taken = (seconds(words, seed) for seed in count(args.seed0))
        rows[case] = list(islice((one for one in taken if one is not None), args.seeds))
        print(f"  {case:<22}{np.median(rows[case]):6.1f} (longest {max(rows[case]):.1f})", flush=True)
    longest = max(map(max, rows.values()))
    print(f"Longest {longest:.1f} s: wanted at most {WANTED:.0f} s{'' if longest <= WANTED else ', MISSED'}.")
    kept = {"cores": os.cpu_count(), "seed0": args.seed0, "seconds": rows}
    keep(RESULTS, kept)


def seconds(words: tuple[str, ...], seed: int) -> float | None:
    """Wall time of one diagnosis [s]; None where the drives of a seed are too weak for what it hides."""
    with tempfile.TemporaryDirectory(prefix="diagnosing") as folder:
        made = Path(folder) / "made"
        simulated = ["--robot", "arm7", "--duration", "40", "--rate", "500", "--wrong", "0.05"]
        failed = _bdnn("simulate", *simulated, "--seed", str(seed), *words, "--out", str(made))
        if "lost its trajectory" in failed:
            return None
        start = time.perf_counter()
        failed = failed or _bdnn("diagnose", str(made / "bag"), "--out", str(Path(folder) / "out"))
        taken = time.perf_counter() - start
    if failed:
        sys.exit(failed)
    return round(taken, 2)


def _bdnn(*words: str) -> str:
    """What a command that failed says; empty where it did not."""
    command = Path(sys.executable).with_name("bdnn")
    done = subprocess.run([command, *words], capture_output=True, text=True)
    return done.stderr.strip() or f"bdnn {words[0]} failed." if done.returncode else ""


if __name__ == "__main__":
    main()
