"""The HTML report of a diagnosis: one file that works offline."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

import bdnn_ros
from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.result import reference
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.urdf import links_of
from bdnn_ros.report import contents, panels, words
from bdnn_ros.report.chart import SIZE
from bdnn_ros.report.view import coverage, link_changes, view
from bdnn_ros.robot.units import printed
from bdnn_ros.written import spelled, write_bytes

SEEN = 0.03
"""A cause whose contribution is this share of the spread of a joint's effort is named there."""
UNCOUNTED = 0.05
"""Where a larger share of a joint's rows does not count, that is said beside its charts."""
SHOWN_FIRST = 6
"""Evidence of so many causes is open; that of further ones is folded away."""


def write_report(
    examination: Examination, model: ExtendedModel, path: Path, data_check: Sequence[str] = ()
) -> None:
    """Write the report of an examination, whole or not at all.

    Args:
        model: what the examination makes of the simulation.
        path: the file, usually `report.html`.
        data_check: what the check of the recordings had to say, one sentence each.
    """
    text = spelled(render(examination, model, data_check))
    write_bytes(path, text.encode())


def render(examination: Examination, model: ExtendedModel, data_check: Sequence[str] = ()) -> str:
    """The report's HTML."""
    shown = view(examination)
    diagnosis = examination.diagnosis
    proofs = [proof for cause in shown.causes if (proof := panels.evidence(shown, cause)) is not None]
    joints = [
        {
            "name": joint,
            "causes": [c.finding for c in shown.causes if c.joint == j],
            "uncounted": 1.0 - float(shown.usable[:, j].mean()),
            "others": [c.finding for c in shown.causes if c.joint != j and c.sizes[j] >= SEEN],
            "effort": panels.effort_panel(shown, j),
            "residual": panels.residual_panel(shown, j),
            "dependence": panels.dependence_panels(shown, j),
        }
        for j, joint in enumerate(shown.joints)
    ]
    first, last = shown.time[shown.excerpt][[0, -1]]
    return (
        _environment()
        .get_template("report.html.j2")
        .render(
            diagnosis=diagnosis,
            since=shown.since,
            reference=reference(shown.since),
            version=bdnn_ros.__version__,
            recorded=contents.recorded(examination),
            roots=contents.roots(diagnosis),
            contests=contents.contests(diagnosis),
            overall=contents.overall(shown),
            errors=contents.joint_errors(shown),
            proofs=proofs[:SHOWN_FIRST],
            more_proofs=proofs[SHOWN_FIRST:],
            joints=joints,
            uncounted=UNCOUNTED,
            unsaid_inputs=[
                one for one in diagnosis.unexplained_depends_on if one not in diagnosis.unexplained_sentence
            ],
            excerpt=None if last - first >= shown.time[-1] - shown.time[0] else (float(first), float(last)),
            parameters=contents.parameter_rows(shown.causes),
            links=contents.link_rows(link_changes(examination, links_of(model))),
            links_share=min(examination.by_links, 1.0),
            rest=panels.rest_panels(shown),
            coverage=coverage(shown),
            units=shown.units,
            checks=[*data_check, *(note for note in diagnosis.notes if note not in data_check)],
            method=contents.method(shown),
            document=json.dumps(diagnosis.as_json(), indent=1, ensure_ascii=False),
        )
    )


def prose(text: str) -> Markup:
    """A sentence with its `commands` set as code; everything escaped."""
    parts = [escape(part) for part in text.split("`")]
    if len(parts) % 2 == 0:
        return escape(text)
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if k % 2 else part for k, part in enumerate(parts)
    )


def _environment() -> Environment:
    """Names of joints, links and bags come from outside: everything is escaped."""
    environment = Environment(
        loader=PackageLoader("bdnn_ros", "report/templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        percent=words.percent,
        probability=words.probability,
        number=words.number,
        unit=printed,
        amounts=words.amounts,
        named=words.named,
        basename=os.path.basename,
        prose=prose,
    )
    environment.globals.update(
        headline=words.headline,
        claim=words.claim,
        needless=words.needless,
        kinds=words.kinds,
        named=words.named,
        size=SIZE,
    )
    return environment
