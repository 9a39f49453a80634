"""extended.urdf carries the rigid robot and the friction of an extended model, and nothing else changes."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import sliding_arm

from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import ModelFileError, RobotError, UsageError
from bdnn_ros.extension.effects_file import EffectsFile, effects_text
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.urdf import beside_urdf, extended_urdf
from bdnn_ros.extension.urdf_text import UrdfText
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.signals import prepare

SPECS = (
    "coulomb_friction@arm7_joint4:coulomb=1.3",
    "viscous_friction@arm7_joint2:viscous=0.7",
    "armature@arm7_joint6:armature=0.05",
    "payload@arm7_link7:mass=1.5,com_x=0.02,com_y=-0.01,com_z=0.1",
    "link_inertia@arm7_link4:scale=1.2",
    "base_tilt:roll_deg=3,pitch_deg=-4",
    "joint_spring@arm7_joint4:stiffness=3.0,rest=-1.5",
    "hysteresis@arm7_joint1:force=0.9,breakaway=0.03",
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.bundled("arm7")


def model_of(robot: Robot, *specs: str) -> ExtendedModel:
    return ExtendedModel(robot, tuple(parse_spec(spec, robot) for spec in specs), np.zeros(robot.width))


def states(robot: Robot, count: int = 50) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return tuple(rng.uniform(-2.0, 2.0, (count, robot.width)) for _ in range(3))  # type: ignore[return-value]


def same_rigid_effort(model: ExtendedModel, again: Robot) -> None:
    state = states(again)
    wanted = model.robot.rigid_effort(*state)
    np.testing.assert_allclose(again.rigid_effort(*state), wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_it_parses_and_gives_the_models_rigid_efforts(robot: Robot, wrong: float) -> None:
    rng = np.random.default_rng(1)
    links = robot.inertials * (1.0 + wrong * rng.standard_normal((7, 1)))
    model = model_of(robot.with_inertials(links), *SPECS)
    again = Robot.from_urdf(extended_urdf(model))
    assert again.joints == robot.joints
    same_rigid_effort(model, again)
    assert again.coulomb[3] == 1.3 and again.viscous[1] == 0.7
    assert again.coulomb.sum() == 1.3 and again.viscous.sum() == 0.7


def test_nothing_to_say_leaves_the_text_alone(robot: Robot) -> None:
    assert extended_urdf(model_of(robot)) == robot.urdf


def test_only_what_changed_is_touched(robot: Robot) -> None:
    before = robot.urdf.splitlines()
    after = extended_urdf(model_of(robot, "coulomb_friction@arm7_joint4:coulomb=1.3")).splitlines()
    added = [line for line in after if line not in before]
    assert [line.strip() for line in added] == ['<dynamics damping="0.0" friction="1.3"/>']
    assert [line for line in before if line not in after] == []


def test_tags_that_were_there_keep_their_other_attributes(robot: Robot) -> None:
    text = robot.urdf.replace("<axis", '<dynamics damping="0.5" friction="0.25" rotor="7"/><axis', 1)
    urdf = extended_urdf(model_of(Robot.from_urdf(text), "viscous_friction@arm7_joint1:viscous=1"))
    dynamics = ElementTree.fromstring(urdf).findall("joint/dynamics")
    assert [tag.attrib for tag in dynamics] == [{"damping": "1.5", "friction": "0.25", "rotor": "7"}]


def test_a_payload_is_a_link_at_its_centre(robot: Robot) -> None:
    tree = ElementTree.fromstring(extended_urdf(model_of(robot, SPECS[3])))
    assert tree.find("link[@name='arm7_link7_payload']/inertial/mass").get("value") == "1.5"
    joint = tree.find("joint[@name='arm7_link7_payload_joint']")
    assert joint.get("type") == "fixed" and joint.find("parent").get("link") == "arm7_link7"
    assert [float(x) for x in joint.find("origin").get("xyz").split()] == [0.02, -0.01, 0.1]


def test_a_scaled_link_is_scaled_itself() -> None:
    """A tool fixed to the last link is a link of its own, and its mass changes there."""
    robot = Robot.bundled("arm7")
    tool = next(link for link in robot.links if "hand" in link)
    urdf = extended_urdf(model_of(robot, f"link_inertia@{tool}:scale=2"))
    masses = [
        float(ElementTree.fromstring(text).find(f"link[@name='{tool}']/inertial/mass").get("value"))
        for text in (robot.urdf, urdf)
    ]
    assert masses[1] == pytest.approx(2.0 * masses[0])
    assert extended_urdf(model_of(robot)).count("<inertial>") == urdf.count("<inertial>")
    same_rigid_effort(model_of(robot, f"link_inertia@{tool}:scale=2"), Robot.from_urdf(urdf))


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.6])
def test_a_bare_frame_that_bears_a_scaled_body_gives_the_models_efforts(scale: float) -> None:
    robot = Robot.bundled("arm7")
    tree = ElementTree.fromstring(robot.urdf)
    for link in ("arm7_link3", "arm7_link7"):
        frame = tree.find(f"link[@name='{link}']")
        inertial = frame.find("inertial")
        frame.remove(inertial)
        ElementTree.SubElement(tree, "link", name=f"{link}_shell").append(inertial)
        bolts = ElementTree.SubElement(tree, "joint", name=f"{link}_bolts", type="fixed")
        ElementTree.SubElement(bolts, "parent", link=link)
        ElementTree.SubElement(bolts, "child", link=f"{link}_shell")
    robot = Robot.from_urdf(ElementTree.tostring(tree, encoding="unicode"))
    wrong = robot.with_inertials(robot.inertials * np.linspace(0.95, 1.05, 7)[:, None])
    for bare in (robot, wrong):
        model = model_of(
            bare, *(f"link_inertia@{link}:scale={scale}" for link in ("arm7_link3", "arm7_link7"))
        )
        same_rigid_effort(model, Robot.from_urdf(extended_urdf(model)))


def test_a_change_that_the_moving_link_cannot_carry_takes_the_whole_body() -> None:
    """The last body is nearly all hand: 70 % less of it cannot come off the flange alone."""
    robot = Robot.bundled("arm7")
    links = robot.inertials.copy()
    links[6] *= 0.3
    model = model_of(robot.with_inertials(links))
    urdf = extended_urdf(model)
    same_rigid_effort(model, Robot.from_urdf(urdf))
    tree = ElementTree.fromstring(urdf)
    masses = [float(mass.get("value")) for mass in tree.findall("link/inertial/mass")]
    assert min(masses) > 0.0


def test_base_tilt_is_the_contracts(robot: Robot) -> None:
    model = model_of(robot, "base_tilt:roll_deg=20,pitch_deg=-35")
    roll, pitch = tilt_of(model.robot.gravity_vector)
    np.testing.assert_allclose(np.degrees([roll, pitch]), [20.0, -35.0])
    tree = ElementTree.fromstring(extended_urdf(model))
    origin = tree.find("joint[@name='level_to_base']/origin")
    np.testing.assert_allclose([float(x) for x in origin.get("rpy").split()], [roll, pitch, 0.0])


@pytest.mark.parametrize("bolt", ["fixed", "revolute"])
def test_a_world_stays_level_and_the_root_under_a_tilted_base(bolt: str) -> None:
    """Simulators hold a root of that name in place: under a link of ours the arm would fall."""
    arm = Robot.bundled("arm7")
    urdf = arm.urdf
    if bolt == "fixed":
        parts = '<link name="world"/><joint name="bolt" type="fixed"><parent link="world"/>'
        parts += (
            '<child link="arm7_link0"/><origin xyz="0.1 0.2 0.3" rpy="0 0 0.5"/><axis xyz="0 0 0"/></joint>'
        )
        urdf = urdf.replace("</robot>", parts + "</robot>")
    else:
        urdf = urdf.replace('"arm7_link0"', '"world"')
    standing = Robot.from_urdf(urdf)
    off = replace(standing, zeros=np.linspace(0.2, -0.3, arm.width))
    model = model_of(off, "base_tilt:roll_deg=6,pitch_deg=-9")
    written = extended_urdf(model)
    tree = ElementTree.fromstring(written)
    children = {child.get("link") for child in tree.findall("joint/child")}
    assert [link.get("name") for link in tree.findall("link") if link.get("name") not in children] == [
        "world"
    ]
    same_rigid_effort(model, Robot.from_urdf(written))


@pytest.mark.parametrize("name", ["arm7", "sliding"])
def test_zeros_are_in_the_joints_origins(name: str) -> None:
    arm = sliding_arm() if name == "sliding" else Robot.bundled(name)
    off = replace(arm, zeros=np.linspace(-0.2, 0.3, arm.width))
    urdf = extended_urdf(model_of(off))
    again = Robot.from_urdf(urdf)
    assert not again.zeros.any()
    same_rigid_effort(model_of(off), again)
    assert extended_urdf(model_of(arm)) == arm.urdf


def test_chosen_joints_and_armature_of_the_simulation(robot: Robot) -> None:
    """With two joints held, and a simulation that was itself identified: its armature goes to the effects."""
    chosen = ("arm7_joint4", "arm7_joint2", "arm7_joint6")
    some = Robot.from_urdf(robot.urdf, chosen)
    some = some.with_inertials(1.1 * some.inertials).with_joint_parameters(armature=np.array([0.1, 0.0, 0.2]))
    model = model_of(some, "armature@arm7_joint4:armature=0.3", "payload@arm7_link7:mass=1")
    again = Robot.from_urdf(extended_urdf(model), chosen)
    same_rigid_effort(model, again)
    beside = {e.target: e.values["armature"] for e in beside_urdf(model)}
    assert beside == {0: pytest.approx(0.4), 2: pytest.approx(0.2)}


def test_urdf_and_effects_are_the_whole_model(robot: Robot, tmp_path) -> None:
    model = model_of(robot.with_inertials(1.03 * robot.inertials), *SPECS)
    urdf = extended_urdf(model)
    path = tmp_path / "effects.yaml"
    path.write_text(effects_text(beside_urdf(model), robot))
    read = Robot.from_urdf(urdf)
    again = ExtendedModel(read, tuple(EffectsFile.read(path).effects(read)), model.noise)
    state = states(robot)
    wanted = model.inverse_dynamics(*state)
    np.testing.assert_allclose(again.inverse_dynamics(*state), wanted, atol=1e-9 * np.abs(wanted).max())
    assert {e.effect.name for e in again.effects} == {"armature", "joint_spring", "hysteresis"}


def test_a_push_is_along_the_axes_of_the_base_that_is_written(robot: Robot, tmp_path) -> None:
    """A tilted base hangs from a level one, and along that one's axes a reader takes the push."""
    push = "external_wrench@arm7_link7:start=0.2,end=0.8,force_x=20,force_z=-15,torque_y=2"
    model = model_of(robot, push, "base_tilt:roll_deg=6,pitch_deg=80")
    path = tmp_path / "effects.yaml"
    path.write_text(effects_text(beside_urdf(model), robot))
    read = Robot.from_urdf(extended_urdf(model))
    again = ExtendedModel(read, tuple(EffectsFile.read(path).effects(read)), model.noise)
    time = np.arange(100) / 100.0
    position = np.sin(time[:, None] + np.arange(robot.width))
    signals = prepare(Recording(time, robot.joints, position, None, np.zeros_like(position), name="swing"))
    wanted = model.predict(signals)
    none = model_of(robot, "base_tilt:roll_deg=6,pitch_deg=80").predict(signals)
    assert np.abs(wanted - none).max() > 5.0
    np.testing.assert_allclose(again.predict(signals), wanted, atol=1e-9 * np.abs(wanted).max())


def test_joints_that_were_held_are_held_again(robot: Robot, tmp_path) -> None:
    chosen = tuple(joint for joint in robot.joints if joint != "arm7_joint3")
    some = Robot.from_urdf(robot.urdf, chosen, {"arm7_joint3": 0.9})
    model = model_of(some, "payload@arm7_link7:mass=1,com_z=0.1")
    path = tmp_path / "effects.yaml"
    path.write_text(effects_text(beside_urdf(model), some))
    again = EffectsFile.read(path).robot(Robot.from_urdf(extended_urdf(model)))
    assert again.joints == chosen and dict(again.held) == {"arm7_joint3": 0.9}
    same_rigid_effort(model, again)
    path.write_text("{joints: [arm7_joint1], held: {arm7_joint3: askew}, effects: []}")
    with pytest.raises(UsageError, match="held is no number"):
        EffectsFile.read(path).robot(robot)


def test_joints_that_nothing_was_recorded_of_stand_where_the_model_has_them(robot: Robot, tmp_path) -> None:
    """At zero, or at the nearest limit."""
    urdf = robot.urdf.replace('lower="-2.8973"', 'lower="0.5"', 1)
    every = Robot.from_urdf(urdf)
    assert every.limits.lower[0] == 0.5
    chosen = every.joints[2:]
    model = model_of(Robot.from_urdf(urdf, chosen, {every.joints[1]: 0.3}))
    path = tmp_path / "effects.yaml"
    path.write_text(effects_text((), model.robot))
    again = EffectsFile.read(path).robot(Robot.from_urdf(extended_urdf(model)))
    assert again.joints == chosen and dict(again.held) == {every.joints[0]: 0.5, every.joints[1]: 0.3}
    same_rigid_effort(model, again)
    path.write_text(f"{{joints: [{chosen[0]}, {chosen[1]}], effects: []}}")
    assert EffectsFile.read(path).robot(robot).joints == chosen[:2]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{joints: [arm7_joint1, arm7_joint1], effects: []}", "named twice in arm7_joint1, arm7_joint1"),
        ("{joints: [arm7_joint1], held: {arm7_joint2: .nan}, effects: []}", "arm7_joint2 is held at nan"),
        ("{joints: [arm7_joint1], held: {arm7_joint2: 1e30}, effects: []}", "arm7_joint2 is held at 1e"),
        ("{joints: [arm7_joint1], held: {arm7_joint1: 0.1}, effects: []}", "one of the joints that move"),
        ("{joints: arm7_joint1, effects: []}", "cannot be read"),
        ("{held: {arm7_joint1: 0.1}, effects: []}", "cannot be read"),
        ("{made: 2024-02-31, effects: []}", "cannot be read .day is out of range"),
        ("{made: !!timestamp never, effects: []}", "cannot be read"),
        ("[" * 3000, "cannot be read"),
    ],
)
def test_joints_that_no_file_of_ours_has_are_refused(robot: Robot, tmp_path, text: str, says: str) -> None:
    (tmp_path / "effects.yaml").write_text(text)
    with pytest.raises(UsageError, match=says):
        EffectsFile.read(tmp_path / "effects.yaml").robot(robot)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[1, 2]", "no list of effects"),
        ("{format: bdnn_ros/effects, version: 9, effects: []}", "version 9"),
        ("{effects: [{effect: gremlin, parameters: {}}]}", "gremlin"),
        ("{effects: [{effect: cogging, joint: arm7_joint1, parameters: {amplitude: 1}}]}", "periods_per_rev"),
        ("{effects: [{effect: cogging, joint: elbow, parameters: {}}]}", "elbow"),
        ("{effects: [7]}", "not complete"),
        ("{effects: [{effect: cogging}]}", "effect 1 of 1: it is not complete: it lacks parameters"),
        ("{effects: [{effect: cogging, parameters: 7}]}", "name and a number"),
        ("{effects: [{effect: coulomb_friction, parameters: {coulomb: 1}}]}", "does not say where"),
        ("{effects: [{effect: payload, parameters: {mass: 1}}]}", "does not say where"),
        (
            "{effects: [{effect: coulomb_friction, link: arm7_link1, parameters: {coulomb: 1}}]}",
            "cannot act on a link. It acts on a joint",
        ),
        (
            "{effects: [{effect: payload, joint: arm7_joint1, link: arm7_link1, parameters: {mass: 1}}]}",
            "a joint and a link",
        ),
        (
            "{effects: [{effect: base_tilt, joint: arm7_joint1, parameters: {roll_deg: 1}}]}",
            "cannot act on 'arm7_joint1'",
        ),
        (
            "{effects: [{effect: coulomb_friction, joint: arm7_joint1, parameters: {coulomb: 1, bogus: 2}}]}",
            "no parameter bogus",
        ),
        (
            "{effects: [{effect: coulomb_friction, joint: arm7_joint1, bogus: 2, parameters: {coulomb: 1}}]}",
            "unknown key bogus",
        ),
        (
            "{effects: [{effect: coulomb_friction, joint: arm7_joint1, parameters: {coulomb: null}}]}",
            "not a number",
        ),
        ("{effects: [{effect: velocity_filter, joint: arm7_joint1, parameters: {cutoff: 0}}]}", "bounds"),
        ("{effects: [{effect: joint_spring, joint: arm7_joint1, parameters: {stiffness: -100}}]}", "bounds"),
        (
            "{effects: [{effect: joint_elasticity, joint: arm7_joint1, parameters: {stiffness: -100}}]}",
            "bounds",
        ),
        (
            "{effects: [{effect: stribeck_friction, joint: arm7_joint1, "
            "parameters: {coulomb: 1, static: 2, velocity: 0}}]}",
            "velocity=0 .* out of bounds",
        ),
        (
            "{effects: [{effect: link_inertia, link: arm7_link4, "
            "parameters: {mass: 5, nominal_mass: 2, scale: 1.2}}]}",
            "contradicts itself",
        ),
        ("{", "cannot be read"),
    ],
)
def test_bad_effects_are_refused(robot: Robot, tmp_path, text: str, says: str) -> None:
    (tmp_path / "effects.yaml").write_text(text)
    with pytest.raises(UsageError, match=says):
        EffectsFile.read(tmp_path / "effects.yaml").effects(robot)


FOUND = (
    ("coulomb_friction@arm7_joint4:coulomb=1", {"coulomb": -0.4}),
    ("viscous_friction@arm7_joint4:viscous=1", {"viscous": -0.4}),
    ("armature@arm7_joint4:armature=1", {"armature": -0.01}),
    ("payload@arm7_link7:mass=1", {"mass": -0.5}),
    ("base_tilt:roll_deg=1", {"roll_deg": 178.0}),
    ("joint_spring@arm7_joint4:stiffness=1", {"rest": 40.0}),
    ("velocity_filter@arm7_joint4:cutoff=10", {"cutoff": 1500.0}),
    ("effort_scale@arm7_joint4:scale=5", {"scale": 5.000000000000001}),
    ("link_inertia@arm7_link4:scale=1.5", {"mass": 3.0, "nominal_mass": 2.0}),
    ("drift@arm7_joint4:of=offset,start_value=0,end_value=1", {}),
)
"""What a fit may find and nobody may ask for: less than an earlier model had, and the nominal mass of other links."""


@pytest.mark.parametrize(("spec", "values"), FOUND)
def test_what_a_diagnosis_writes_is_read_again(robot: Robot, tmp_path, spec: str, values: dict) -> None:
    asked = parse_spec(spec, robot)
    found = replace(asked, values={**asked.values, **values})
    path = tmp_path / "effects.yaml"
    path.write_text(effects_text([found], robot))
    assert EffectsFile.read(path).effects(robot) == [found]
    model = ExtendedModel(robot, (found,), np.zeros(robot.width))
    assert ExtendedModel.from_state(*model.to_state()).effects == (found,)


def test_a_model_with_an_effect_nowhere_is_refused(robot: Robot) -> None:
    arrays, info = model_of(robot, "coulomb_friction@arm7_joint4:coulomb=1").to_state()
    info["effects"][0]["joint"] = None
    with pytest.raises(ModelFileError, match="coulomb_friction does not say where"):
        ExtendedModel.from_state(arrays, info)


def test_a_joint_of_an_effects_file_stands_for_the_link_it_moves(robot: Robot, tmp_path) -> None:
    path = tmp_path / "effects.yaml"
    path.write_text("effects: [{effect: payload, joint: arm7_joint7, parameters: {mass: 1}}]")
    assert EffectsFile.read(path).effects(robot) == [parse_spec("payload@arm7_joint7:mass=1", robot)]


@pytest.mark.parametrize("declared", ["ISO-8859-1", "utf-8"])
def test_a_description_of_another_encoding_is_written_in_the_one_it_declares(tmp_path, declared: str) -> None:
    """A bag's description is text whatever it declares; a file is read by its declaration."""
    line = f'<?xml version="1.0" encoding="{declared}"?>'
    text = line + Robot.bundled("arm2").urdf.partition("?>")[2].replace("arm2_joint1", "gélenk")
    model = model_of(Robot.from_urdf(text), "coulomb_friction@gélenk:coulomb=1")
    (tmp_path / "extended.urdf").write_text(extended_urdf(model), encoding="utf-8")
    again = Robot.from_file(tmp_path / "extended.urdf")
    assert again.joints == model.joints
    assert extended_urdf(model).startswith(line) == (declared == "utf-8")


def test_text_edits_keep_every_other_character() -> None:
    links = '<link name="a>"/><link  name="b"><x/></link >'
    text = f'<?xml version="1.0"?>\n<!-- ä -->\n<robot name="r">\n {links}\n</robot>\n'
    document = UrdfText(text)
    assert document.text() == text
    document.append(document.named("link", "a>"), "<y/>")
    document.put(document.named("link", "b"), "x", "<z/>")
    expected = text.replace('<link name="a>"/>', '<link name="a>">\n    <y/>\n  </link>').replace(
        "<x/>", "<z/>"
    )
    assert document.text() == expected
    assert document.root_link() == "a>" and document.free_name("link", "b") == "b_2"


@pytest.mark.parametrize("text", ["", "<robot>", "<sdf/>"])
def test_what_is_no_urdf_is_refused(text: str) -> None:
    with pytest.raises(RobotError):
        UrdfText(text)


def test_an_extended_urdf_can_be_extended_again(robot: Robot) -> None:
    once = Robot.from_urdf(extended_urdf(model_of(robot, *SPECS)))
    model = model_of(once, SPECS[0], SPECS[3], "link_inertia@arm7_link7_payload:scale=2")
    urdf = extended_urdf(replace(model, bare=once))
    same_rigid_effort(model, Robot.from_urdf(urdf))
    assert Robot.from_urdf(urdf).coulomb[3] == pytest.approx(2.6)
