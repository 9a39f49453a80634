"""From node parameters to the settings of a session."""

from __future__ import annotations

from bdnn_ros.nodes.parameters import Settings
from bdnn_ros.online import serving


def session_settings(settings: Settings) -> serving.Settings:
    """The settings of a session by the values of the parameters `IDENTIFICATION`."""
    return serving.Settings(
        effort_source=settings["effort_source"],
        effort_factors=tuple(settings["effort_factors"]),
        add_gravity=settings["add_gravity"],
        cutoff=settings["cutoff"] or None,
        capacity=settings["buffer_size"],
        niceness=settings["trainer_niceness"],
        diagnosis_period=settings["diagnosis_period"],
        diagnosis_window=settings["diagnosis_window"],
    )
