"""A BDNN on prior knowledge: any dynamics, and networks that learn only the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.bdnn.restoring import Build, prior_core
from bdnn_ros.robot.entries import reading


@dataclass(frozen=True)
class BDNNOnPrior(BDNN):
    """The same seed form on a prior that was given, see `cores.PriorCore`."""

    kind: ClassVar[str] = "bdnn_on_prior"

    @classmethod
    def from_state(
        cls, arrays: dict[str, np.ndarray], info: dict[str, Any], build: Build | None = None
    ) -> BDNNOnPrior:
        """The model of `to_state`.

        Args:
            build: makes a prior that is not a `Robot` from its kind, arrays and info.

        Raises:
            ModelFileError: something is missing or does not fit, or the prior's kind needs `build`.
        """
        with reading("The BDNN", "Identify it again.", arrays, info) as (arrays, info):
            return cls(prior_core(arrays, info, build))
