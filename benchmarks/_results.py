"""How benchmarks keep what they measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bdnn_ros.written import whole


def keep(path: Path, results: Any) -> None:
    """Write results as JSON, whole or not at all."""
    path.parent.mkdir(exist_ok=True)
    with whole(path) as beside:
        beside.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
