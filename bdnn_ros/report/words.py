"""Wording: effects, verdicts, numbers and units as an engineer writes them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from bdnn_ros.diagnosis.judging.identifiability import TIE
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Quantity, Rival, place, reference, remaining
from bdnn_ros.diagnosis.telling.case import SLIGHT
from bdnn_ros.effects.base import Change, Parameter
from bdnn_ros.effects.drift import Drift
from bdnn_ros.effects.registry import ALL, get
from bdnn_ros.errors import listed
from bdnn_ros.robot.units import printed

INTERVAL = 1.96
"""Standard deviations on each side of a 95 % interval."""
PLACED = 1e-6
"""Spread of what is zero because it was put there, as the point of a push."""
MOST_IN_LINE = 3
"""So many parameters go into one line of the verdict; an effect with more has them in the table."""

TELLING = ("mass", "torque", "start_value", "end_value")
"""The parameters that stand for an effect of many."""

CLAIMS = {
    "nothing_wrong": "The {reference} predicts the measured effort as well as this data can tell.",
    "explained": "With {these} and its {parts} corrected the model predicts every measured effort down to its noise.",
    "partly_explained": "{These} {explain} part of the error; most of what the extended model mends has no name.",
    "cannot_tell": "The {reference} errs by more than the noise, but the data supports no single {one}.",
}
LEFT = "With {these} and the links corrected, {left} of the {reference}'s squared error is left above the noise, at {above}."
"""What is claimed of causes beside which more than the noise is left somewhere."""
OPEN = "{These} {explain} the error; what is told as a push may be another cause."
"""What is claimed where a push is not seen to begin or to end."""
UNCHANGED = "No change since the model was identified can be shown: nothing that was found surely predicts better than it does."
"""What takes the place of what disagrees, where the gain on an earlier model may be nothing: no model is without any error."""
WITHOUT_A_NAME = "the extended model corrects without a name, as errors of the links, of stamps or of how friction comes on"
SLIGHTLY = {
    "nothing_wrong": "The {reference} predicts the measured effort without any cause; at {slight} little is left, though more "
    "than the noise.",
    "explained": "With {these} and its {parts} corrected the model predicts the measured efforts down to their noise but at "
    "{slight}, where little more is left.",
}
"""What is claimed where what is left at some joints is more than twice the noise, though little."""
CORRECTED = (
    f"No cause is needed beyond what {WITHOUT_A_NAME}: that takes {{gain}} off the {{reference}}'s error."
)
"""What takes the place of the claim that nothing is wrong, where what it is compared with is `corrected`."""


def title(effect: str, variant: str = "") -> str:
    """The title of an effect in a list: without article, capitalised; for a drift with what drifts."""
    own = get(effect, variant) if variant else None
    if isinstance(own, Drift):
        return f"Drifting {own.title}"
    same = [known for known in ALL if known.name == effect]
    # A name with variants (what pushes) stands for all of them; the sentence tells which.
    text = same[0].title if len(same) == 1 else effect.replace("_", " ")
    for article in ("a ", "an "):
        text = text.removeprefix(article)
    return text[:1].upper() + text[1:]


def at(joint: str | None, link: str | None, effect: str) -> str:
    """The place after a title: "at panda_joint4"; empty for the base, which the title names."""
    where = place(joint, link, effect)
    return "" if where == "base" else f"at {where}"


def named(one: Finding | Rival) -> str:
    """An effect with its place: "Coulomb friction at panda_joint4"."""
    return f"{title(one.effect, one.variant)} {at(one.joint, one.link, one.effect)}".rstrip()


def _causes(diagnosis: Diagnosis) -> list[Finding]:
    """The findings that concern the efforts."""
    return [finding for finding in diagnosis.findings if not finding.of_velocity]


def headline(diagnosis: Diagnosis, since: bool = False) -> str:
    """The verdict in one line; `since` if an earlier model is compared instead of the simulation."""
    # of a reported velocity is what explains no effort: it counts where nothing else is found
    findings = _causes(diagnosis) or diagnosis.findings
    if diagnosis.verdict == "nothing_wrong":
        return "Nothing has changed" if since else "Nothing wrong found"
    if unshown(diagnosis, since):
        return "No change can be shown"
    if not findings or diagnosis.verdict == "cannot_tell":
        return f"{'Something has changed' if since else 'The simulation is off'}, and no cause stands out"
    if len(findings) > 1 and not _causes(diagnosis):
        other = "is filtered otherwise" if since else "is low-passed"
        return f"The reported velocity {other} at {len(findings)} joints, and no effort needs a cause"
    if len(findings) == 1:
        return f"One {'change' if since else 'root cause'}: {decapitalised(named(findings[0]))}"
    return f"{len(findings)} {'changes' if since else 'root causes'} found"


def claim(diagnosis: Diagnosis, since: bool = False) -> str:
    """The meaning of the verdict for the model, one sentence; `since` as for `headline`."""
    count, one = len(_causes(diagnosis)), "change" if since else "cause"
    of_effort = "nothing_wrong" if needless(diagnosis) else diagnosis.verdict
    these, explain = (f"this {one}", "explains") if count == 1 else (f"these {count} {one}s", "explain")
    if of_effort == "nothing_wrong" and corrected(diagnosis):
        return CORRECTED.format(gain=percent(diagnosis.gain, 1), reference=reference(since))
    if unshown(diagnosis, since):
        return UNCHANGED
    if of_effort == "partly_explained" and diagnosis.above:
        left, above = remaining(diagnosis.unexplained_share), listed(diagnosis.above)
        return LEFT.format(these=these, left=left, reference=reference(since), above=above)
    if of_effort == "partly_explained" and diagnosis.endless:
        return OPEN.format(These=these.capitalize(), explain=explain)
    claims = CLAIMS | SLIGHTLY if diagnosis.slight else CLAIMS
    return claims[of_effort].format(
        one=one,
        these=these,
        These=these.capitalize(),
        explain=explain,
        reference=reference(since),
        slight=listed(diagnosis.slight),
        parts=" and ".join(dict.fromkeys(("links", *diagnosis.also))),
    )


def needless(diagnosis: Diagnosis) -> bool:
    """Whether the efforts need no cause, whatever is found about reported velocities; any gain is without a name then."""
    return diagnosis.verdict in ("nothing_wrong", "explained") and not _causes(diagnosis)


def unshown(diagnosis: Diagnosis, since: bool) -> bool:
    """Whether there is no named finding, and the earlier model may be as good as the new one."""
    return since and diagnosis.verdict == "cannot_tell" and diagnosis.gain_interval[0] <= 0.0


def corrected(diagnosis: Diagnosis) -> bool:
    """Whether the extended model certainly improves on more than a correct simulation would leave."""
    return diagnosis.gain_interval[0] >= SLIGHT


def kinds(findings: Sequence[Finding]) -> str:
    """Many findings in one line by kind: "Coulomb friction at 7 places, rotor inertia at 3 places"."""
    counts = Counter(map(cause, findings))
    parts = [f"{decapitalised(name)} at {n} place{'s' if n > 1 else ''}" for name, n in counts.most_common()]
    text = ", ".join(parts)
    return text[:1].upper() + text[1:]


def cause(*findings: Finding) -> str:
    """The title of findings of one kind in a list, after "Less" if there is less of it than in the model."""
    plain, changes = title(findings[0].effect, findings[0].variant), set(map(change, findings))
    if changes == {"more"}:
        return plain
    return f"{'Less' if changes == {'less'} else 'More or (negative) less'} {decapitalised(plain)}"


def change(finding: Finding) -> Change:
    """Whether there is more or less of a cause than in the model."""
    values = {name: quantity.value for name, quantity in finding.parameters.items()}
    return get(finding.effect, finding.variant).change(values)


def decapitalised(text: str) -> str:
    """A title within a sentence; names such as Coulomb and Stribeck keep their capital."""
    return text if text.startswith(("Coulomb", "Stribeck")) else text[:1].lower() + text[1:]


def amounts(finding: Finding) -> list[str]:
    """The parameters with their 95 % uncertainty, one text each; of many only the most informative."""
    shown = {name: q for name, q in finding.parameters.items() if estimated(name, q)} or finding.parameters
    if len(shown) > MOST_IN_LINE:
        shown = {name: q for name, q in shown.items() if name in TELLING}
    several = len(shown) > 1 or any(q.unit == "-" for q in shown.values())
    return [(f"{label(name)} " if several else "") + with_spread(q) for name, q in shown.items()]


def estimated(name: str, quantity: Quantity) -> bool:
    """Whether a parameter is estimated from the data, not given by description, recording length or a reference point."""
    placed = quantity.value == 0.0 and quantity.std <= PLACED
    return quantity.std > 0.0 and not placed and not name.startswith("nominal_")


def label(name: str) -> str:
    """The name of a parameter in text."""
    return name.removesuffix("_deg").replace("_", " ")


def with_spread(quantity: Quantity) -> str:
    """Value ± half its 95 % interval, unit."""
    half, symbol = INTERVAL * quantity.std, printed(quantity.unit)
    space = "" if symbol in ("", "°") else " "
    if not (half > 0.0 and math.isfinite(half)):
        return f"{number(quantity.value)}{space}{symbol}"
    decimals = decimals_of(half)
    return f"{fixed(quantity.value, decimals)} ± {fixed(half, decimals)}{space}{symbol}"


def estimate(name: str, quantity: Quantity, parameter: Parameter | None) -> tuple[str, str]:
    """The value with significant decimals, and its 95 % interval within the possible range, or why there is none."""
    if not estimated(name, quantity):
        return number(quantity.value), "–"
    if parameter is not None and not parameter.seen(quantity.value, quantity.std):
        return "–", "not shown by this motion"
    half = INTERVAL * quantity.std
    low, high = quantity.value - half, quantity.value + half
    # what lies beyond a bound, as where there is less than there was, is not held by it
    if parameter is not None:
        low = max(low, parameter.lower) if quantity.value >= parameter.lower else low
        high = min(high, parameter.upper) if quantity.value <= parameter.upper else high
    decimals = decimals_of(half)
    return fixed(quantity.value, decimals), f"{fixed(low, decimals)} to {fixed(high, decimals)}"


def decimals_of(spread: float) -> int:
    """Decimals that show a spread with two digits if it starts with 1 or 2, else with one."""
    if not (spread > 0.0 and math.isfinite(spread)):
        return 3
    power = math.floor(math.log10(spread))
    return min(max(1 - power if spread / 10.0**power < 2.95 else -power, 0), 9)


def fixed(value: float, decimals: int) -> str:
    """A number with fixed decimals and a true minus sign."""
    return f"{value:.{decimals}f}".replace("-", "−")


def number(value: float, digits: int = 3) -> str:
    """A number with some significant digits and a true minus sign, without exponent if that is short."""
    if not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    if -3 <= decimals <= 6:
        return fixed(value, max(decimals, 0))
    return f"{value:.{digits - 1}e}".replace("-", "−")


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent."""
    if not math.isfinite(share):
        return "–"
    if abs(share) < 0.5 * 10.0 ** (-2 - digits) and share <= 0.0:
        share = 0.0
    if 0.0 < share < 0.005 and digits == 0:
        return "<\N{NO-BREAK SPACE}1\N{NO-BREAK SPACE}%"
    return f"{fixed(100.0 * share, digits)}\N{NO-BREAK SPACE}%"


def certainty(finding: Finding) -> tuple[float, str]:
    """Probability that the effect is present at all, and what the finding's own probability refers to.

    The effect may be present but at another place or in another variant (what drifts), or as part of a larger one, as Coulomb
    friction is of Stribeck friction. The text is empty if both probabilities are the same.
    """
    alike = [rival for rival in finding.rivals if rival.effect == finding.effect]
    others = {
        "that it is here": [rival for rival in alike if not _same_place(rival, finding)],
        f"that it is {get(finding.effect, finding.variant).title}": [
            rival for rival in alike if _same_place(rival, finding)
        ],
        "that it is no more than that": [rival for rival in finding.rivals if _contains(rival, finding)],
    }
    likely = {said: _likely(rivals) for said, rivals in others.items()}
    there = sum(likely.values())
    return min(finding.probability + there, 1.0), max(likely, key=likely.__getitem__) if there else ""


def _likely(rivals: Iterable[Rival]) -> float:
    """Total probability of some rivals; empty if negligible."""
    total = sum(rival.probability for rival in rivals)
    return total if total >= TIE else 0.0


def _contains(rival: Rival, finding: Finding) -> bool:
    return _same_place(rival, finding) and finding.effect in get(rival.effect, rival.variant).contains


def _same_place(rival: Rival, finding: Finding) -> bool:
    return (rival.joint, rival.link) == (finding.joint, finding.link)


def probability(p: float) -> str:
    """A probability in per cent, never 0 or 100."""
    if p > 0.99:
        return ">\N{NO-BREAK SPACE}99\N{NO-BREAK SPACE}%"
    return percent(0.004 if p < 0.01 else p)
