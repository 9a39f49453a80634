"""The parts of a model that files of links and effects cannot express, in words."""

from __future__ import annotations

from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.physical.model import PhysicalModel

NETWORKS = "what the networks learned"


def of_joints(model: PhysicalModel) -> list[str]:
    """The learned joint terms of an identified model."""
    parts = ["motors that turn with two joints"] if model.motors.couplings else []
    return parts + (["what the joints' networks learned"] if model.learned and model.learned.active else [])


def unwritten(model: ExtendedModel) -> list[str]:
    """All of these, with the properties of a recording that only `predict` includes."""
    beyond = model.beyond
    parts = [] if beyond is None else of_joints(beyond)
    if beyond is not None and beyond.robot.coulomb.any():
        parts.append("the travel in which dry friction turns round")
    if model.networks:
        parts.append(NETWORKS)
    if model.lead or (beyond is not None and beyond.lead):
        parts.append("the lead of the recorded effort")
    if model.lag or (beyond is not None and beyond.lag):
        parts.append("the low-pass that the recorded effort had passed")
    if any(model.sticking):
        parts.append("how far dry friction turns round before its joint does")
    if model.creep:
        parts.append("the velocity at which dry friction is all there")
    return parts
