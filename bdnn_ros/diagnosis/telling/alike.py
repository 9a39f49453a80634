"""Links that are all off by one factor: efforts in a wrong unit do the same, and no motion tells which."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.result import Finding, Rival
from bdnn_ros.diagnosis.search.search import LINK_ERRORS
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.effects.actuation import EffortScale
from bdnn_ros.effects.rigid import LinkInertia

LIKELIER = 3.0
"""Evidence by which one common factor must beat individual link errors to be reported [nats]."""
SCALED = 2
"""Fewest joints with efforts named as scaled that make the unit of the others' efforts doubtful as well."""
FEWEST = 3
"""Fewest named links with about the same factor that may all be right, with the efforts' unit wrong."""
BY_EFFORT = ("N", "kg")
"""How units of parameters begin that are measured in efforts."""
AGREES = 2.0
"""Distance in standard deviations of both within which a link's factor agrees with the common one."""


@dataclass(frozen=True)
class Common:
    """Ratio of all efforts to the simulated ones, with its standard deviation."""

    factor: float
    std: float

    def note(self, kind: Kind) -> Note:
        """A note of it."""
        return Note(kind, {"factor": self.factor, "std": self.std, "scale": 1.0 / self.factor})


def common(equations: Equations, fitted: Pool) -> Common | None:
    """One factor of all efforts that is likelier than individual link errors, with or without the named ones; None without."""
    pool = Pool(equations, fitted.noise, fitted.terms, fitted.link_error)
    rest = [c for c, term in enumerate(pool.terms) if term.effect.name != LinkInertia.name]
    alone, best = -math.inf, (-math.inf, 0.0, 0.0)
    for each in map(pool.with_link_error, LINK_ERRORS):
        fit = each.fit(rest)
        alone, best = max(alone, fit.evidence, each.whole.evidence), max(best, _beside(each, fit))
    evidence, more, std = best
    return Common(1.0 + more, std) if evidence > alone + LIKELIER else None


def _beside(pool: Pool, fit: Fit) -> tuple[float, float, float]:
    """Evidence of a common factor beside a fit, its excess over one, and its standard deviation.

    The factor is a shift of the links' prior mean, plus a column for what the simulation has beside links, such as friction. A
    column of all efforts would be nearly collinear with the links' and lost in rounding.
    """
    equations, believed = pool.equations, EffortScale.coefficient_spread**-2.0
    links = equations.errors.masses.astype(float)
    beside = (
        equations.decimation.as_rows(equations.decimation.simulated.load, borne=False)
        - equations.rigid @ links
    )
    white = equations.whitening.of(beside, pool.noise)
    pull = fit.precision * np.pad(links, (0, len(fit.precision) - len(links)))
    known = pool.white[:, :, pool.columns_of(fit.terms)]
    across = np.einsum("rjp,rj->p", known, white) - pull
    own = float(np.sum(white**2)) + float(pull[: len(links)] @ links) + believed
    own = max(own - float(across @ fit.covariance @ across), believed)
    left = float(np.sum(white * pool.white_residual(fit))) + float(pull @ fit.coefficients)
    return fit.evidence + 0.5 * (left**2 / own - math.log(own / believed)), left / own, own**-0.5


def tied(findings: Sequence[Finding], alike: Common | None) -> list[Finding]:
    """Findings as sure as they are where no motion tells all links from all efforts.

    Links that agree on one factor have the efforts' unit as an even rival. Where efforts of several joints are scaled, those
    of the others may be by that factor: all that is measured in efforts is then off by it.
    """
    if alike is None:
        return list(findings)
    if scaled(findings):
        findings = [_doubted(one, alike) for one in findings]
    agree = [_agrees(one, alike) for one in findings]
    even = sum(agree) >= FEWEST
    return [_tossed(one) if even and agrees else one for one, agrees in zip(findings, agree, strict=True)]


def scaled(findings: Sequence[Finding]) -> list[str]:
    """The joints whose efforts are named as scaled, if there are several; else none."""
    joints = [one.joint for one in findings if one.effect == EffortScale.name and one.joint is not None]
    return joints if len(joints) >= SCALED else []


def untold(findings: Sequence[Finding]) -> bool:
    """Whether the efforts' unit is a rival of some findings, or decides how large they are."""
    rivals = (everywhere(rival.effect, rival.joint) for one in findings for rival in one.rivals)
    return bool(scaled(findings)) or any(rivals)


def everywhere(effect: str, joint: str | None) -> bool:
    """Whether an effect at a joint (or None) is the unit of all efforts, which no motion tells from the links."""
    return effect == EffortScale.name and joint is None


def _agrees(one: Finding, alike: Common) -> bool:
    if one.effect != LinkInertia.name:
        return False
    scale = one.parameters["scale"]
    return abs(scale.value - alike.factor) <= AGREES * math.hypot(scale.std, alike.std)


def _doubted(one: Finding, alike: Common) -> Finding:
    """A finding with what is measured in efforts as unsure as the efforts' unit."""
    off = abs(1.0 - 1.0 / alike.factor)
    widened = {
        name: replace(known, std=math.hypot(known.std, known.value * off))
        for name, known in one.parameters.items()
        if name != "nominal_mass"  # as the model has it
        and (one.effect == EffortScale.name or known.unit.startswith(BY_EFFORT))
    }
    return replace(one, parameters={**one.parameters, **widened})


def _tossed(one: Finding) -> Finding:
    half = 0.5 * one.probability
    unit = Rival(EffortScale.name, None, None, half)
    return replace(one, probability=half, rivals=(unit, *one.rivals))
