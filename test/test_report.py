"""The report of a diagnosis: complete, self-contained, escaped, readable on any screen."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import pytest
from report_cases import examined, fourier_motion, rendered, unchanged, worn
from report_page import Page

from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.diagnosis.result import Rival
from bdnn_ros.recording import Recording
from bdnn_ros.report import contents
from bdnn_ros.report.plots import effort_figure, identification_png
from bdnn_ros.report.report import write_report
from bdnn_ros.report.view import view
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, prepare

HOSTILE = "</pre><img src=x onerror=alert(1)>\"' {{7*7}} <script>alert(2)</script>"
THREE = (
    "coulomb_friction@arm7_joint4:coulomb=1.3",
    "payload@arm7_joint7:mass=1.2,com_z=0.08,com_x=0.02",
    "viscous_friction@arm7_joint1:viscous=2",
)
BROWSER = next((b for b in ("chromium", "chromium-browser", "google-chrome") if shutil.which(b)), None)


@pytest.fixture(scope="module")
def arm() -> Robot:
    return Robot.bundled("arm7")


@pytest.fixture(scope="module")
def three(arm: Robot) -> Examination:
    recording = worn(arm, THREE, fourier_motion(arm))
    rivals = [
        Rival("stribeck_friction", "arm7_joint4", None, 0.31),
        Rival("hysteresis", "arm7_joint4", None, 0.05),
    ]
    advice = ["Record slow reversals; `bdnn excite --for diagnosis.json` makes such a motion."]
    return examined(arm, recording, THREE, rivals=rivals, advice=advice, notes=["3 samples left out."])


@pytest.fixture(scope="module")
def hostile() -> Examination:
    """Two joints, one of them, the bag, and all sentences with names that want to be markup."""
    plain = Robot.bundled("arm2")
    name = escape(HOSTILE, {'"': "&quot;", "'": "&apos;"})
    robot = Robot.from_urdf(plain.urdf.replace('name="arm2_joint1"', f'name="{name}"'))
    assert robot.joints[0] == HOSTILE
    specs = ["coulomb_friction@arm2_joint2:coulomb=0.1"]
    recording = worn(robot, specs, fourier_motion(robot, 15.0))
    rivals = [Rival("stribeck_friction", HOSTILE, None, 0.3), Rival(HOSTILE, None, HOSTILE, 0.1)]
    return examined(
        robot, recording, specs, rivals=rivals, advice=[HOSTILE], notes=[HOSTILE], depends_on=HOSTILE
    )


@pytest.fixture(scope="module")
def page(three: Examination) -> Page:
    return Page(rendered(three, ["No gap."]))


def nothing_found(robot: Robot, verdict: str) -> Examination:
    return examined(robot, worn(robot, [], fourier_motion(robot, 15.0)), [], verdict=verdict)


# -- form ---------------------------------------------------------------------------------------------------


def test_the_page_is_well_formed(page: Page) -> None:
    assert page.problems == []
    assert max(Counter(page.values("id")).values()) == 1
    assert {h[1:] for h in page.values("href") if h.startswith("#")} <= set(page.values("id"))


def test_headings_are_in_order(page: Page) -> None:
    assert page.headings[0] == 1 and page.headings.count(1) == 1
    assert (np.diff(page.headings) <= 1).all()


def test_every_chart_says_in_words_what_it_shows(page: Page, three: Examination) -> None:
    charts = 7 * 6 + 3 * 2
    labels = [value for value in page.values("aria-label") if value.startswith(("Residual of", "Effort of"))]
    assert len(labels) == page.values("role").count("img") == page.tags["svg"] == charts
    assert all(len(label) > 20 for label in labels)


@pytest.mark.parametrize("case", ["three", "hostile"])
def test_nothing_is_fetched_and_nothing_runs(case: str, request: pytest.FixtureRequest) -> None:
    text = rendered(request.getfixturevalue(case))
    found = Page(text)
    assert not {"script", "img", "iframe", "object", "embed", "form", "base"} & set(found.tags)
    assert not re.search(r"https?:|@import|url\(|srcset|<!--", text)
    assert all(value.startswith(("#", "data:,")) for value in found.values("href"))
    assert not found.values("src") and not [name for _, name, _ in found.attributes if name.startswith("on")]
    assert "default-src 'none'" in text


def test_names_from_outside_stay_text(hostile: Examination) -> None:
    found = Page(rendered(hostile, [HOSTILE]))
    assert found.problems == []
    assert re.sub(r"\s+", " ", HOSTILE) in found.words
    assert "49" not in re.findall(r"alert\(1\)>\"' (\S+)", found.words)
    assert json.loads("".join(found.pre)) == hostile.diagnosis.as_json()


def test_the_machine_readable_part_is_the_diagnosis(page: Page, three: Examination) -> None:
    assert json.loads("".join(page.pre)) == three.diagnosis.as_json()


def test_a_report_of_seven_joints_is_small_and_quick(arm: Robot, tmp_path: Path) -> None:
    specs = [
        f"{effect}@{joint}:{parameter}={value * scale}"
        for joint, value in zip(arm.joints, (3.0, 4.0, 2.0, 2.0, 0.5, 0.4, 0.3), strict=True)
        for effect, parameter, scale in (
            ("coulomb_friction", "coulomb", 1.0),
            ("viscous_friction", "viscous", 0.5),
            ("armature", "armature", 0.1),
        )
    ]
    examination = examined(arm, worn(arm, specs, fourier_motion(arm, 40.0)), specs)
    begin = time.process_time()
    write_report(examination, unchanged(examination), tmp_path / "report.html")
    assert time.process_time() - begin < 4.0
    assert (tmp_path / "report.html").stat().st_size < 3e6
    found = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert found.problems == []
    assert "21 root causes" in found.words and "15 more" in found.words
    assert "Coulomb friction at 7 places" in found.words


# -- content ------------------------------------------------------------------------------------------------


def test_the_top_lists_the_causes_with_numbers_gain_and_doubt(page: Page, three: Examination) -> None:
    words = page.words
    assert "3 root causes found" in words
    assert re.search(r"Coulomb friction at arm7_joint4 1\.\d+ ± 0\.\d+ N·m", words)
    assert re.search(r"Payload at arm7_link7 1\.\d+ ± 0\.\d+ kg", words)
    assert "This data cannot tell it from: Stribeck friction at arm7_joint4 (31 %)" in words
    assert "bdnn excite --for diagnosis.json" in words and "`" not in words
    gain = f"{100.0 * three.diagnosis.gain:.1f} %"
    assert words.index(gain) < words.index("Root causes identified")
    for finding in three.diagnosis.findings:
        assert finding.sentence in words


def test_everything_promised_is_there(page: Page) -> None:
    for heading in (
        "What cannot be told",
        "Evidence for each cause",
        "Error by joint",
        "Joint by joint",
        "Parameters",
        "Corrections of the links",
        "Unexplained rest",
        "Data check",
        "How it was computed",
    ):
        assert heading in page.words
    assert "No gap." in page.words and "3 samples left out." in page.words
    assert "Low-pass" in page.words and "bdnn_ros 0" in page.words


@pytest.mark.parametrize(("share", "said"), [(0.123, "12"), (1.71, "100")])
def test_what_the_links_make_up_is_as_held_out(three: Examination, share: float, said: str) -> None:
    """That of all rows is flattered; and causes may undo some of it."""
    shown = " ".join(Page(rendered(replace(three, by_links=share))).words.split())
    assert f"their corrections make up {said} % of the simulation's squared error" in shown


@pytest.mark.parametrize(
    ("verdict", "says"),
    [("nothing_wrong", "Nothing wrong found"), ("cannot_tell", "no cause stands out")],
)
def test_a_report_without_findings_says_so(verdict: str, says: str) -> None:
    found = Page(rendered(nothing_found(Robot.bundled("arm2"), verdict)))
    assert found.problems == []
    assert says in found.words and "Evidence for each cause" not in found.words


def test_against_an_earlier_model_it_speaks_of_changes(three: Examination) -> None:
    class Earlier:
        def predict(self, signals: Signals) -> np.ndarray:
            raise AssertionError("the examination has its prediction already")

    words = Page(rendered(replace(three, model=Earlier()))).words
    assert "3 changes found" in words and "earlier model → extended model" in words
    assert "imulat" not in words
    nothing = replace(nothing_found(Robot.bundled("arm2"), "nothing_wrong"), model=Earlier())
    assert "Nothing has changed" in Page(rendered(nothing)).words


def test_a_diagnosis_as_it_is_made_is_reported() -> None:
    robot = Robot.bundled("arm2")
    recording = worn(robot, ["coulomb_friction@arm2_joint2:coulomb=0.2"], fourier_motion(robot, 20.0))
    examination = examine([recording], robot)
    found = Page(rendered(examination))
    assert found.problems == []
    assert json.loads("".join(found.pre)) == examination.diagnosis.as_json()
    assert any(finding.joint == "arm2_joint2" for finding in examination.diagnosis.findings)
    shown = view(examination)
    held = shown.usable & shown.held[:, None]
    before = np.sqrt(np.mean(np.where(held, shown.before, 0.0) ** 2, axis=0) / held.mean(axis=0))
    np.testing.assert_allclose(before, examination.diagnosis.effort_rmse["simulation"], rtol=1e-6)
    without = replace(shown, usable=shown.usable & [False, True])
    absent, measured = contents.joint_errors(without)
    assert np.isnan([absent.spread, absent.simulation, absent.extended, absent.floor]).all()
    assert absent.simulation_width == absent.extended_width == absent.floor_width == 0.0
    assert contents.overall(without)["simulation"] == pytest.approx(measured.simulation)
    overall = contents.overall(shown)
    assert overall["simulation"] == pytest.approx(np.sqrt(np.mean(shown.before[held] ** 2)))
    assert 1.0 - overall["extended"] / overall["simulation"] == pytest.approx(examination.diagnosis.gain)
    seldom = replace(shown, usable=shown.usable & ((np.arange(len(held)) % 4 == 0)[:, None] | [True, False]))
    count = (seldom.usable & seldom.held[:, None]).sum(axis=0)
    assert count[1] < 0.4 * count[0]
    assert contents.overall(seldom)["simulation"] == pytest.approx(np.sqrt(before**2 @ count / count.sum()))


def test_a_joint_without_a_sensor_has_no_error() -> None:
    """Zero would be a perfect model."""
    robot = Robot.bundled("arm2")
    recording = worn(robot, ["coulomb_friction@arm2_joint2:coulomb=0.2"], fourier_motion(robot, 20.0))
    effort = recording.require_effort() * [0.0, 1.0]
    table = (
        rendered(examine([replace(recording, effort=effort)], robot))
        .split('id="gain"')[1]
        .split("</table>")[0]
    )
    absent, measured = (row.split("</tr>")[0] for row in table.split('<tr><th scope="row">')[1:])
    assert absent.count("–") == 5 and "nan" not in table
    assert measured.count("–") == 0


# -- files --------------------------------------------------------------------------------------------------


def test_a_report_is_written_whole_or_not_at_all(
    three: Examination, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "report.html"
    path.write_text("before")

    def fail(*_: object) -> None:
        raise OSError("no space")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="no space"):
        write_report(three, unchanged(three), path)
    assert path.read_text() == "before" and os.listdir(tmp_path) == ["report.html"]


def test_figures_are_png_files(hostile: Examination, tmp_path: Path) -> None:
    effort_figure(hostile, tmp_path / "effort.png")
    signals = replace(hostile.equations.motion.signals, joints=("$\\frac{", HOSTILE))
    assert signals.effort is not None
    for nominal in (None, 0.5 * signals.effort):
        identification_png(tmp_path / "identified.png", signals, signals.effort, nominal)
    for name in ("effort.png", "identified.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG\r\n")
    assert sorted(os.listdir(tmp_path)) == ["effort.png", "identified.png"]


def test_the_effort_of_a_slide_is_drawn_in_newtons(monkeypatch, tmp_path: Path) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr("bdnn_ros.report.plots._write", lambda *given: drawn.append(given))
    time, values = np.arange(400) / 200.0, np.zeros((400, 2))
    signals = prepare(Recording(time, ("a", "b"), values, values, values))
    identification_png(tmp_path / "a.png", signals, signals.velocity, slides=np.array([1, 0]) > 0)
    assert list(drawn[0][2]) == ["N", "N·m"]


# -- in a browser -------------------------------------------------------------------------------------------


def browse(page: Path, profile: Path, width: int, *options: str) -> subprocess.CompletedProcess[str]:
    assert BROWSER is not None
    quiet = [
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
    ]
    return subprocess.run(
        [
            BROWSER,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            *quiet,
            f"--user-data-dir={profile}",
            f"--window-size={width},900",
            *options,
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_a_browser_shows_it_without_complaint(three: Examination, tmp_path: Path) -> None:
    write_report(three, unchanged(three), tmp_path / "report.html")
    done = browse(
        tmp_path / "report.html", tmp_path / "profile", 1280, "--enable-logging=stderr", "--dump-dom"
    )
    assert "3 root causes found" in done.stdout
    assert "CONSOLE" not in done.stderr


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
@pytest.mark.parametrize("case", ["three", "hostile"])
def test_a_phone_scrolls_no_page_sideways(case: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    text = rendered(request.getfixturevalue(case), ["a" * 300])
    text = re.sub(r"<meta http-equiv.*?>", "", text)
    measure = "document.title = [innerWidth, document.documentElement.scrollWidth].join('/')"
    (tmp_path / "report.html").write_text(
        text.replace("</body>", f"<script>{measure}</script></body>"), encoding="utf-8"
    )
    done = browse(tmp_path / "report.html", tmp_path / "profile", 390, "--dump-dom")
    found = re.search(r"<title>(\d+)/(\d+)</title>", done.stdout)
    assert found is not None
    assert int(found[1]) <= 500 and int(found[2]) <= int(found[1])
