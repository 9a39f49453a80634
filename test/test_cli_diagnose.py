"""`bdnn diagnose` as users call it: its files, what it says, what changed since, and honest refusals."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from bdnn_cases import black_box
from diagnosis_cases import check_contract
from report_page import Page

from bdnn_ros import bags
from bdnn_ros.bdnn.field import Scales
from bdnn_ros.cli.diagnose import _grouped, _probability, _rivals, _share, _together, verdict_lines
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.recorded.lowpass import CUTOFF_OF_USUAL, CUTOFFS
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Quantity, Rival
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.models import load_model, save_model
from bdnn_ros.recording import Recording
from bdnn_ros.report.words import claim
from bdnn_ros.robot import Robot
from bdnn_ros.signals.kernels import lagging
from bdnn_ros.simulation.simulate import simulate

J1, J2 = "arm2_joint1", "arm2_joint2"
FILES = {
    *("diagnosis.json", "report.html", "model.bdnn"),
    *("extended.urdf", "extended.mjcf.xml", "effects.yaml", "effort.png"),
}


def simulated(out: Path, *arguments: str) -> Path:
    """The directory of a simulated recording of the 2-axis arm."""
    words = ["--robot", "arm2", "--duration", "20", "--rate", "250", *arguments, "--out", str(out)]
    assert main(["simulate", *words]) == 0
    return out


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """A recording with Coulomb friction on the first joint."""
    return simulated(
        tmp_path_factory.mktemp("bags") / "rubs", "--effect", f"coulomb_friction@{J1}:coulomb=0.8"
    )


@pytest.fixture(scope="module")
def diagnosed(recording, tmp_path_factory) -> tuple[Path, str]:
    """The directory a process of its own wrote, and what it printed."""
    out = tmp_path_factory.mktemp("out") / "deep" / "diagnosis"
    words = [sys.executable, "-m", "bdnn_ros.cli.main", "diagnose", str(recording / "bag"), "--out", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=100, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return out, done.stdout


def test_names_that_are_no_text_are_in_the_results_as_codes(tmp_path, capfd):
    """A bag and a description whose paths hold a byte that no character has."""
    bag, urdf, out = (tmp_path / os.fsdecode(b"\xff" + name) for name in (b"bag", b"arm.urdf", b"out"))
    arm = Robot.bundled("arm2")
    urdf.write_text(arm.urdf)
    made = simulated(tmp_path / "made", "--duration", "12", "--rate", "50") / "bag"
    made.rename(bag)
    assert main(["diagnose", str(bag), "--urdf", str(urdf), "--out", str(out)]) == 0, capfd.readouterr().err
    source = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))["source"]
    assert source["bags"] == [str(tmp_path / "\\udcffbag")] and source["urdf"].endswith("\\udcffarm.urdf")
    assert "\\udcffbag" in (out / "report.html").read_text(encoding="utf-8")
    capfd.readouterr()
    assert main(["info", str(bag), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["bag"] == source["bags"][0]


def report_of(out: Path) -> dict:
    """diagnosis.json, in the contract's form."""
    report = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    check_contract(report)
    return report


def changed_bag(recording: Path, path: Path, change) -> Path:
    """Another bag from the same recording, changed."""
    return bags.write(change(bags.read(recording / "bag")), path)


def test_every_file_of_the_contract_is_there_and_nothing_else_is_left(diagnosed):
    out, _ = diagnosed
    names = {path.name for path in out.iterdir()}
    assert names >= FILES
    assert not [name for name in names if name.startswith(".") or name.endswith(".part")]
    assert all((out / name).stat().st_size > 100 for name in FILES)


def test_the_diagnosis_names_the_cause(diagnosed, recording):
    out, printed = diagnosed
    report = report_of(out)
    assert report["source"]["bags"] == [str(recording / "bag")] and report["source"]["joints"] == [J1, J2]
    assert (report["source"]["samples"], report["source"]["rate"]) == (5000, 250.0)
    (finding,) = report["findings"]
    assert (finding["effect"], finding["joint"], finding["link"]) == ("coulomb_friction", J1, None)
    coulomb = finding["parameters"]["coulomb"]
    assert coulomb["unit"] == "N*m" and coulomb["value"] == pytest.approx(0.8, rel=0.03)
    assert finding["share"] > 0.5
    assert all(finding["probability"] > 2.0 * rival["probability"] for rival in finding["rivals"])
    assert report["verdict"] == "explained" and report["gain"]["interval"][0] > 0.5
    assert finding["sentence"] in printed and str(out / "report.html") in printed


def test_the_report_opens(diagnosed):
    out, _ = diagnosed
    text = (out / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.problems == [] and page.tags["html"] == 1
    assert report_of(out)["findings"][0]["sentence"] in " ".join(" ".join(page.text).split())
    links = [value for _, name, value in page.attributes if name in ("src", "href")]
    assert not [value for value in links if value.startswith(("http:", "https:", "//"))]


def test_a_diagnosis_that_cannot_be_written_leaves_what_was_there(recording, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    for name in FILES:
        (out / name).write_text("of an earlier diagnosis")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("bdnn_ros.cli.diagnose.write_report", full)
    assert main(["diagnose", str(recording / "bag"), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert f"{out} cannot be written (No space left on device). Make room" in said
    assert {path.name for path in out.iterdir()} == FILES
    assert {path.read_text() for path in out.iterdir()} == {"of an earlier diagnosis"}


def test_what_is_odd_about_the_data_is_said_and_reported(recording, tmp_path, capsys):
    """But of a velocity behind a low-pass, which a finding tells of."""

    def odd(given: Recording) -> Recording:
        slow = lagging(given.velocity[:, :1], 1.0 / (2.0 * np.pi * 6.0), given.rate)
        return replace(given, velocity=np.hstack([slow, 3.0 * given.velocity[:, 1:]]))

    assert (
        main(["diagnose", str(changed_bag(recording, tmp_path / "odd", odd)), "--out", str(tmp_path / "out")])
        == 0
    )
    (printed,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Data check: ")]
    said = printed.removeprefix("Data check: ")
    assert f"the velocity of {J2} is 3.00 times its position's derivative" in said
    text = " ".join((tmp_path / "out" / "report.html").read_text(encoding="utf-8").split())
    check = text[text.index('id="data"') :]
    assert said.split("'")[0] in check and f"{J1} lags" not in check
    report = report_of(tmp_path / "out")
    assert report["notes"][-1] == said and J1 not in " ".join(report["notes"])
    assert ("velocity_filter", J1) in [(one["effect"], one["joint"]) for one in report["findings"]]


def test_the_model_and_the_robot_predict_what_was_found(diagnosed, recording, capsys):
    out, _ = diagnosed
    extended = Robot.from_file(out / "extended.urdf")
    assert extended.joints == (J1, J2) and extended.coulomb[0] == pytest.approx(0.8, rel=0.03)
    assert load_model(out).joints == (J1, J2)
    assert 'frictionloss="0' in (out / "extended.mjcf.xml").read_text()
    assert isinstance(yaml.safe_load((out / "effects.yaml").read_text()), dict)
    assert main(["evaluate", str(out), str(recording), "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)
    scores = scores.get("held_out", scores)
    assert max(scores["nrmse"]) < 0.1


def test_a_cause_that_many_joints_have_is_said_in_one_line():
    def finding(effect: str, joint: str, share: float, rivals: tuple[Rival, ...] = ()) -> Finding:
        name = get(effect).parameters[0].name
        quantity = {name: Quantity(share, 0.01, "N*m")}
        return Finding(effect, joint, None, quantity, share, 0.9, rivals, f"{effect} at {joint}.")

    rubs = [
        finding("coulomb_friction", joint, share) for joint, share in (("a", 0.3), ("b", 0.1), ("c", 0.1))
    ]
    tie = (Rival("quadratic_drag", "b", None, 0.08), Rival("viscous_friction", "a", None, 0.3))
    drags = finding("quadratic_drag", "a", 0.4, tie)
    diagnosis = Diagnosis(
        source={},
        verdict="explained",
        findings=(drags, *rubs),
        effort_rmse={},
        gain=0.9,
        gain_interval=(0.8, 0.95),
        unexplained_share=0.0,
        unexplained_depends_on=(),
        unexplained_sentence="Nothing is left.",
        advice=(),
        notes=("2 samples were left out.", "The links are far off."),
    )
    read = ("2 samples were left out.",)  # said when it was read
    _, first, second, doubt, *rest = verdict_lines(SimpleNamespace(diagnosis=diagnosis, model=None), read)
    assert "The links are far off." in rest and "2 samples were left out." not in rest
    assert "3 places" in first and "a 0.3; b 0.1; c 0.1" in first
    assert first.endswith("(10.0 to 30.0 % of the squared error each, probability 0.90)")
    assert "quadratic_drag at a." in second and "40.0 %" in second
    assert "viscous_friction at a 0.30" in doubt


def test_a_kind_is_no_surer_than_its_least_sure_and_its_shares_do_not_add_up():
    """One that may be part of more was told with its own certainty for all; single removals came to 230 %.

    Nor is its doubt all of theirs.
    """
    more, other = Rival("stribeck_friction", "a", None, 0.39), Rival("hysteresis", "b", None, 0.14)
    rubs = [
        Finding("coulomb_friction", joint, None, {"coulomb": Quantity(1.0, 0.1, "N*m")}, 0.8, own, rivals, "")
        for joint, own, rivals in (("a", 0.60, (more,)), ("b", 0.85, (other,)), ("c", 0.99, ()))
    ]
    assert _probability(rubs) == "at least 0.85, at a 0.60 that it is no more than that"
    alike = [rubs[0], replace(rubs[0], joint="d", probability=0.55, rivals=(replace(more, joint="d"),))]
    assert _probability([*alike, rubs[1]]) == "at least 0.85, at least 0.55 that it is no more than that"
    elsewhere = replace(rubs[2], probability=0.7, rivals=(replace(more, effect="coulomb_friction"),))
    assert _probability([*rubs, elsewhere]).endswith(
        "at a 0.60 that it is no more than that, at c 0.70 that it is here"
    )
    assert _probability([replace(one, probability=0.9, rivals=()) for one in rubs]) == "0.90"
    assert _probability(rubs[:1]) == "0.99, 0.60 that it is no more than that"
    assert _share(rubs) == "80.0 % of the squared error each"
    assert _share(rubs[:1]) == "80.0 % of the squared error"


def test_what_else_may_drift_is_told_apart():
    rival = Rival("drift", "a", None, 0.19, "viscous")
    ends = {"start_value": Quantity(1.0, 0.1, "N*m"), "end_value": Quantity(4.0, 0.1, "N*m")}
    drifts = Finding("drift", "a", None, ends, 0.1, 0.8, (rival,), "", "coulomb")
    assert _rivals(drifts).strip() == "drift (coulomb) at a could also be: drift (viscous) at a 0.19"


def test_its_help_says_behind_which_low_pass_it_compares(capsys):
    """It was that of other verbs: 10 Hz, behind which nothing is compared."""
    assert main(["diagnose", "--help"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert f"compared behind {CUTOFF_OF_USUAL:g} times as much" in told
    assert f"behind {min(CUTOFFS):g} to {max(CUTOFFS):g}, the less the noisier" in told


def test_a_kind_at_many_places_is_called_by_its_title():
    """A drift of viscous friction was called Coulomb friction, the first that may drift, and later a drift of nothing."""
    ends = {"start_value": Quantity(0.1, 0.01, "N*m*s/rad"), "end_value": Quantity(0.4, 0.01, "N*m*s/rad")}
    drifts = [Finding("drift", joint, None, ends, 0.2, 0.99, (), "", "viscous") for joint in "abc"]
    less = {"viscous": Quantity(-0.3, 0.01, "N*m*s/rad")}
    rubs = [Finding("viscous_friction", joint, None, less, 0.1, 0.99, (), "") for joint in "abc"]
    assert _together(drifts).startswith("Drifting viscous friction at 3 places, start_value [N·m·s/rad], ")
    assert _together(rubs).startswith("Less viscous friction than the model at 3 places, viscous ")


def test_what_drifts_is_not_put_together_with_what_else_drifts():
    """Coulomb friction and an offset have the same parameters in the same units."""
    ends = {"start_value": Quantity(1.0, 0.1, "N*m"), "end_value": Quantity(4.0, 0.1, "N*m")}
    drifts = [
        Finding("drift", joint, None, ends, 0.1, 0.99, (), f"{what} of {joint} drifts.", what)
        for what, joints in (("coulomb", "abc"), ("offset", "de"))
        for joint in joints
    ]
    groups = _grouped(drifts)
    assert [[finding.joint for finding in group] for group in groups] == [["a", "b", "c"], ["d"], ["e"]]
    assert _together(groups[0]).startswith("Drifting Coulomb friction at 3 places, ")


@pytest.mark.parametrize(
    ("interval", "said"),
    [((0.07, 0.29), "The simulation agrees with"), ((0.9, 0.97), "No cause is needed to explain")],
)
def test_a_simulation_that_needs_corrections_is_not_said_to_agree(interval: tuple[float, float], said: str):
    lag = Finding(
        "velocity_filter", "a", None, {"cutoff": Quantity(9.0, 0.1, "Hz")}, 0.9, 0.99, (), "It lags."
    )
    diagnosis = Diagnosis({}, "explained", (lag,), {}, 0.95, interval, 0.0, (), "Nothing is left.", (), ())
    first, *rest = verdict_lines(SimpleNamespace(diagnosis=diagnosis, model=None))
    assert first.startswith(said) and first.endswith("of a reported velocity only:")
    told = [line for line in rest if "95.0 %" in line]
    assert len(told) == (interval[0] > 0.5) and all("without a name" in line for line in told)
    assert not any(line.startswith("Gain") for line in rest)


def test_where_more_than_noise_is_left_is_said_first():
    found = Finding(
        "viscous_friction", "a", None, {"viscous": Quantity(1.0, 0.1, "N*m*s/rad")}, 0.9, 0.99, (), ""
    )
    diagnosis = Diagnosis({}, "partly_explained", (found,), {}, 0.9, (0.8, 0.95), 0.1, (), "", (), (), ("b",))
    for model, named in ((None, "Root causes"), (object(), "Changes")):
        alone = replace(diagnosis, above=())
        left, unnamed, endless = (
            verdict_lines(SimpleNamespace(diagnosis=one, model=model))[0]
            for one in (diagnosis, alone, replace(alone, noted=(Note(Kind.ENDLESS),)))
        )
        assert endless == f"{named} identified; what is told as a push may be another cause:"
        assert left == f"{named} identified; beside them more than the noise is left at b:"
        assert unnamed == f"{named} identified; most of what the extended model mends has no name:"


def test_what_agrees_only_with_errors_that_are_no_findings_is_not_said_of_the_causes_alone():
    found = Finding("armature", "a", None, {"armature": Quantity(0.02, 0.001, "kg*m^2")}, 0.1, 0.99, (), "")
    alone = Diagnosis({}, "explained", (found,), {}, 0.9, (0.8, 0.95), 0.0, (), "", ())
    links, stamps = Note(Kind.MOSTLY_LINKS), Note(Kind.BY_LEAD)
    for noted, beside, parts in (
        ((), "", "links"),
        ((links,), " and with what is told of links below", "links"),
        ((links, stamps), " and with what is told of links and stamps below", "links and stamps"),
        ((stamps,), " and with what is told of stamps below", "links and stamps"),
    ):
        diagnosis = replace(alone, noted=noted)
        first = verdict_lines(SimpleNamespace(diagnosis=diagnosis, model=None))[0]
        assert first == f"Root causes identified; with them{beside} the model agrees with the data:"
        assert claim(diagnosis).startswith(f"With this cause and its {parts} corrected the model")


def test_nothing_is_wrong_with_the_extended_robot(diagnosed, recording, tmp_path, capsys):
    """The round trip: the same recording against the extended URDF."""
    out, _ = diagnosed
    words = [
        "diagnose",
        str(recording),
        "--urdf",
        str(out / "extended.urdf"),
        "--out",
        str(tmp_path / "again"),
    ]
    assert main(words) == 0
    report = report_of(tmp_path / "again")
    assert report["findings"] == [] and report["verdict"] == "nothing_wrong"
    assert report["source"]["urdf"] == str(out / "extended.urdf")
    assert "Nothing wrong" in capsys.readouterr().out


def without_description(recording: Recording) -> Recording:
    return replace(recording, urdf=None)


def without_effort(recording: Recording) -> Recording:
    return replace(recording, effort=None)


def weightless(recording: Recording) -> Recording:
    bare = ElementTree.fromstring(recording.urdf)
    for link in bare.findall("link"):
        for inertial in link.findall("inertial"):
            link.remove(inertial)
    return replace(recording, urdf=ElementTree.tostring(bare, encoding="unicode"))


def short(recording: Recording) -> Recording:
    return recording.split(0.8)[0]


def sparse(recording: Recording) -> Recording:
    """At 5 Hz, so short that no row is left to hold out."""
    return recording.part(np.arange(0, len(recording), round(recording.rate / 5.0))[:45])


def resting(recording: Recording) -> Recording:
    still = np.zeros_like(recording.position)
    return replace(recording, position=still, velocity=still)


@pytest.mark.parametrize(
    "change, status, says",
    [
        (without_description, 2, "--urdf"),
        (without_effort, 1, "effort"),
        (weightless, 2, "none of the moving links a mass"),
        (short, 1, "s of motion are too short for a diagnosis"),
        (sparse, 1, "s of motion are too short for a diagnosis"),
        (resting, 1, "move"),
    ],
)
def test_what_cannot_be_diagnosed_is_refused_in_one_sentence(
    recording, tmp_path, capsys, change, status, says
):
    bag = changed_bag(recording, tmp_path / "bag", change)
    capsys.readouterr()
    assert main(["diagnose", str(bag), "--out", str(tmp_path / "out")]) == status
    error = capsys.readouterr().err
    assert error.count("bdnn: error:") == 1 and says in error.lower() and "Traceback" not in error
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_a_low_pass_that_leaves_too_little_is_named(tmp_path, capsys):
    made = simulate(Robot.bundled("arm2"), seed=1, duration=15.0, rate=100.0).recording
    words = ["diagnose", str(bags.write(made, tmp_path / "bag")), "--out", str(tmp_path / "out")]
    assert main([*words, "--cutoff", "0.4"]) == 1
    error = capsys.readouterr().err
    assert "15.0 s hold too little motion for a diagnosis behind a low-pass of 0.4 Hz" in error
    assert "Give a higher --cutoff" in error and "10 s" not in error


def test_an_unknown_model_or_bag_is_wrong_usage(recording, tmp_path, capsys):
    out = ["--out", str(tmp_path / "out")]
    assert main(["diagnose", str(recording), "--model", str(tmp_path / "none.bdnn"), *out]) == 2
    assert main(["diagnose", str(tmp_path / "nothing"), *out]) != 0
    assert main(["diagnose", str(recording)]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("description", [(), ("--urdf", "a.urdf"), ("--robot", "arm2")])
def test_a_description_beside_a_model_is_said_not_to_count(before, tmp_path, capsys, description):
    words = ["diagnose", str(tmp_path / "nothing"), "--model", str(before), "--out", str(tmp_path / "out")]
    assert main([*words, *description]) == 2
    said = f"bdnn: note: the recording is compared with {before}, not with {''.join(description[1:])}."
    assert (said in capsys.readouterr().err) == bool(description)


def test_a_black_box_is_no_simulation_to_compare_with(recording, tmp_path, capsys):
    ones = np.ones(2)
    save_model(tmp_path / "box", black_box((J1, J2), Scales(ones, ones, ones, 0.1 * ones), hidden=8))
    words = ["diagnose", str(recording), "--model", str(tmp_path / "box"), "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "--prior urdf" in capsys.readouterr().err


@pytest.fixture(scope="module")
def before(tmp_path_factory) -> Path:
    """A model of a worn arm, identified before anything changed."""
    folder = tmp_path_factory.mktemp("before")
    bag = simulated(folder / "bag", "--worn", "--wrong", "0.05", "--seed", "1")
    assert main(["identify", str(bag), "--out", str(folder / "model")]) == 0
    return folder / "model"


def changes(before: Path, tmp_path: Path, *arguments: str) -> list[dict]:
    """What a later recording of the same arm, moving otherwise, says of it."""
    later = ("--worn", "--wrong", "0.05", "--seed", "1", "--duration", "22", *arguments)
    bag = simulated(tmp_path / "after", *later)
    assert main(["diagnose", str(bag), "--model", str(before), "--out", str(tmp_path / "out")]) == 0
    return report_of(tmp_path / "out")["findings"]


def test_nothing_has_changed(before, tmp_path):
    assert changes(before, tmp_path) == []


def test_the_joint_whose_friction_grew_is_all_that_changed(before, tmp_path):
    (finding,) = changes(before, tmp_path, "--effect", f"coulomb_friction@{J2}:coulomb=0.04")
    assert (finding["effect"], finding["joint"]) == ("coulomb_friction", J2)
    assert finding["parameters"]["coulomb"]["value"] == pytest.approx(0.04, rel=0.1)


def test_what_sensors_of_an_earlier_diagnosis_do_is_said_and_is_no_change(tmp_path, capsys):
    effects = f"position_offset@{J1}:offset=0.1", f"effort_scale@{J2}:scale=0.7"
    arm = Robot.bundled("arm2")
    model = ExtendedModel(arm, tuple(parse_spec(spec, arm) for spec in effects), np.full(2, 0.01))
    save_model(tmp_path / "before", model)
    bag = simulated(tmp_path / "now", *(word for spec in effects for word in ("--effect", spec)))
    words = ["diagnose", str(bag), "--model", str(tmp_path / "before"), "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert report_of(tmp_path / "out")["findings"] == []
    said = capsys.readouterr().out
    assert f"efforts are looked at as they act by the earlier model, times 0.7 at {J2}." in said
    assert "Data check" not in said


def test_the_payload_of_two_joints_is_all_that_changed(before, tmp_path):
    (finding,) = changes(before, tmp_path, "--effect", "payload@arm2_link2:mass=0.5,com_x=0.1")
    named = {finding["effect"], *(rival["effect"] for rival in finding["rivals"])}
    assert finding["link"] == "arm2_link2" and "payload" in named
    assert finding["effect"] in ("payload", "link_inertia")
