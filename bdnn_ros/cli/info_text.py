"""What `bdnn info` prints of what it found."""

from __future__ import annotations

from typing import Any

from bdnn_ros.cli.options import counted
from bdnn_ros.cli.tables import headed, labels, some_slide
from bdnn_ros.robot import Robot


def printed(report: dict[str, Any], robot: Robot | None) -> str:
    """The report of `bdnn info`, line by line."""
    lines = [
        report["bag"],
        *(f"  {t['name']}  {t['type']}  {counted(t['count'], 'message')}" for t in report["topics"]),
    ]
    if "samples" in report:
        gaps = report["gaps"]
        lines += [
            f"{counted(report['samples'], 'sample')} of {counted(len(report['joints']), 'joint')} "
            f"in {report['recorded']:.2f} s"
            f"{' without gaps' if gaps['count'] else ''}: "
            f"{report['rate']:.4g} Hz, jitter {1e3 * report['jitter']:.3g} ms "
            f"(longest step {1e3 * report['longest_step']:.3g} ms)",
            f"{counted(gaps['count'], 'gap')}, longest {gaps['longest']:.3g} s, {gaps['total']:.3g} s in all",
            f"not in the bag: {', '.join(report['missing']) or 'nothing'}",
        ]
    if "excitation" in report:
        lines += ["", *_table(report["excitation"], robot)]
        lines += [f"- {text}" for text in report.get("concerns", ())]
    if report["usable"]:
        lines.append(_fit(bool(report["breaches"]), robot))
    return "\n".join(lines)


def _fit(broken: bool, robot: Robot | None) -> str:
    """The last line on a recording that is usable, perhaps after something else."""
    if robot is None:
        return "Fit for identification, with a robot description from --urdf FILE or --robot NAME."
    if broken:
        return (
            "Fit for identification once recording and description go together, see above; until then `bdnn diagnose` "
            "refuses it."
        )
    return "Fit for identification."


def _table(rows: list[dict[str, Any]], robot: Robot | None) -> list[str]:
    names = labels(robot, [row["joint"] for row in rows], "rad", "N*m")
    width, position = max(map(len, names)), headed(robot, "position", "rad")
    speed, faster, force = ("per s", "per s²", "") if some_slide(robot) else ("rad/s", "rad/s²", "[N·m]")
    lines = [
        f"{'':{width}}    {position:14}   velocity  acceleration  effort's std             at rest  clipped",
        f"{'':{width}}    from       to  {f'[{speed}]':>9}  {f'[{faster}]':>12}  {force:>12}  reversals     [%]      [%]",
    ]
    for name, row in zip(names, rows, strict=True):
        joint, still = f"{name:{width}}", "" if row["moves"] else "  does not move"
        effort = "-" if row["effort"] is None else f"{row['effort']:.3g}"
        clipped = "-" if row["saturated"] is None else f"{100 * row['saturated']:.3g}"
        turns, rest = row["reversals"], 100 * row["standstill"]
        lines.append(
            f"{joint} {row['lower']:7.3f}  {row['upper']:7.3f}  {row['velocity']:9.3g}  "
            f"{row['acceleration']:12.3g}  {effort:>12}  {turns:9}  {rest:6.3g}  "
            f"{clipped:>7}{still}"
        )
    return lines
