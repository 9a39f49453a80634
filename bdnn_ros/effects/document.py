"""Writes docs/effects.md from the registry: `python -m bdnn_ros.effects.document [FILE]`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from bdnn_ros.effects.base import Effect, Parameter
from bdnn_ros.effects.registry import ALL, EFFECTS
from bdnn_ros.written import whole

HEAD = """# Effects: what a simulation may leave out

Written from the registry by `python -m bdnn_ros.effects.document`; do not edit.

Sign convention: `M(q) qdd + C(q,qd) qd + g(q) + friction + ... = effort that really acts`, and
`effort that really acts(t) = scale * measured(t - delay) + offset`. Each equation below is what the effect
adds to the *measured* effort. SI units, radians; degrees only where the name ends in `_deg`. Where a joint
slides, N takes the place of N·m, m that of rad, kg that of kg·m². A specification is
`effect[@joint or link][:key=value,...]`, for example `coulomb_friction@arm7_joint4:coulomb=1.3`.

Bounds say what is physically possible, and the diagnosis keeps to them. Plausible values are what
`simulate --hide` draws from, before it scales them to the share of the effort that was asked for; "of effort"
means that they are multiples of the joint's typical effort.
"""
PLACES = {"joint": "a joint", "link": "a link", "base": "the base", "all": "all joints"}


def document() -> str:
    """The text of docs/effects.md."""
    rows = [f"| [`{name}`](#{name}) | {_places(name)} | {_summary(EFFECTS[name])} |" for name in EFFECTS]
    table = "\n".join(["| effect | on | what it is |", "|---|---|---|", *rows])
    return "\n".join([HEAD, table, "", *(_section(name) for name in EFFECTS)])


def _section(name: str) -> str:
    kinds = [effect for effect in ALL if effect.name == name]
    lines = [f"## {name}", ""]
    for effect in kinds:
        if effect.variant:
            lines += [f"### {name}, {_variant(effect)}", ""]
        lines += [" ".join((effect.__doc__ or "").split()), "", f"    {effect.equation}", ""]
        lines += ["| parameter | unit | bounds | plausible | default |", "|---|---|---|---|---|"]
        lines += [_row(parameter) for parameter in effect.parameters]
        confused = ", ".join(f"`{other}`" for other in effect.confused_with)
        lines += ["", f"Confused with: {confused}."]
        if effect.contains:
            lines += [f"Contains: {', '.join(f'`{other}`' for other in effect.contains)}."]
        if effect.settles_into:
            lines += [f"Settles into: `{effect.settles_into}`."]
        lines += [f"Shown by: {effect.shown_by}.", f"Source: {effect.source}.", ""]
    return "\n".join(lines)


def _variant(effect: Effect) -> str:
    if effect.name == "external_wrench":
        return f"on a {effect.on}"
    return f"`of={effect.variant}`" + ", the default" * (effect is EFFECTS[effect.name])


def _row(parameter: Parameter) -> str:
    low, high = (_number(edge) for edge in (parameter.lower, parameter.upper))
    plausible = " to ".join(_number(edge) for edge in parameter.plausible)
    if parameter.plausible == Parameter("", "").plausible:
        plausible = ""
    default = parameter.default
    default = f"`{default}`" if isinstance(default, str) else "" if default is None else _number(default)
    share = " of effort" if parameter.of_effort else ""
    return f"| `{parameter.name}` | {parameter.unit} | {low} to {high} | {plausible}{share} | {default} |"


def _number(value: float) -> str:
    if np.isinf(value):
        return "∞" if value > 0 else "-∞"
    return f"{value:.4g}"


def _summary(effect: Effect) -> str:
    """The first paragraph of the docstring of the class that gives the effect its name."""
    named = next(kind for kind in type(effect).__mro__ if "name" in vars(kind))
    return " ".join((named.__doc__ or "").split("\n\n")[0].split()).rstrip(".")


def _places(name: str) -> str:
    places = [where for effect in ALL if effect.name == name for where in (effect.on, *effect.also_on)]
    return " or ".join(PLACES[where] for where in dict.fromkeys(places))


def main() -> None:
    """Writes the file named on the command line, docs/effects.md by default."""
    path = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/effects.md")
    with whole(path) as beside:
        beside.write_text(document(), encoding="utf-8")


if __name__ == "__main__":
    main()
