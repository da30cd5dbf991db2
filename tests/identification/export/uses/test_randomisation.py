"""Ranges for training, their names and files of simulators."""

import ast
import sys
from dataclasses import replace
from types import ModuleType
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import yaml

from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Bound, Value
from identification.export.corrected.corrected_mjcf import corrected_mjcf
from identification.export.corrected.corrected_model import CorrectedModel, corrected_model
from identification.export.uses.randomisation import randomisation_of, unseen_effect, unseen_sizes
from identification.export.uses.randomisation_file import mjcf_ranges, randomisation_text
from identification.export.uses.simulator_files import isaac_lab_text, simulators_text
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

UNSEEN = (
    Bound("viscous_friction", "elbow", "coefficient", 0.02, "N m s/rad"),
    Bound("torque_offset", "elbow", "torque", 0.05, "N m"),
    Bound("input_delay", None, "delay", 0.004, "s"),
    Bound("transmission_compliance", "elbow", "compliance", 0.001, "rad/(N m)"),
)


@pytest.fixture
def friction(made):
    """Coulomb and viscous friction of the elbow, anticorrelated."""
    shared = ((0.03, 0.0),), ((-0.008, 0.006),)
    return (
        made("coulomb_friction", "elbow", shared[0], torque=Value(0.5, 0.03, "N m")),
        made("viscous_friction", "elbow", shared[1], coefficient=Value(0.1, 0.01, "N m s/rad")),
    )


def test_findings_that_do_not_say_what_they_share_are_drawn_apart(planar, diagnosed, friction):
    made = randomisation_of(diagnosed(*(replace(f, loadings=()) for f in friction)), planar)
    np.testing.assert_allclose(made.correlation, np.eye(2))
    np.testing.assert_allclose(made.std, [0.03, 0.01])


def test_a_bound_that_says_too_little_makes_no_effect(planar, diagnosed):
    bound = Bound("stribeck_friction", "elbow", "static_torque", 0.1, "N m")
    assert unseen_effect(randomisation_of(diagnosed(), planar), bound, 1.0) is None


def test_fields_have_the_ranges_of_drawn_robots(planar, diagnosed, made, friction, rng):
    payload = made(
        "payload", None, mass=Value(0.5, 0.02, "kg"), center_x=Value(0.02, 0.001, "m"),
        center_y=Value(0.0, 0.001, "m"), center_z=Value(-0.4, 0.005, "m"),
    )  # fmt: skip
    found = randomisation_of(diagnosed(*friction, payload), planar)
    values = rng.multivariate_normal(found.values, found.loadings @ found.loadings.T, 300)
    models = [
        mujoco.MjModel.from_xml_string(corrected_mjcf(corrected_model(planar, robot)))
        for robot in map(found.with_values, values)
    ]
    ranges = {(f.name, f.attribute): f for f in mjcf_ranges(found)[0]}
    for field, values in (
        (("elbow", "frictionloss"), [model.dof_frictionloss[1] for model in models]),
        (("elbow", "damping"), [model.dof_damping[1] for model in models]),
        (("lower", "mass"), [model.body_mass[2] for model in models]),
    ):
        half = 0.5 * (ranges[field].found[1] - ranges[field].found[0])
        assert half == pytest.approx(2 * np.std(values), rel=0.15)
        assert ranges[field].value == pytest.approx(np.mean(values), rel=0.02)


def test_what_was_not_seen_widens_its_field(planar, diagnosed, friction):
    ranges = mjcf_ranges(randomisation_of(diagnosed(*friction, bounds=UNSEEN), planar))[0]
    damping = next(f for f in ranges if (f.name, f.attribute) == ("elbow", "damping"))
    assert damping.unseen == (pytest.approx(0.2), pytest.approx(0.22))
    delay = next(f for f in ranges if (f.name, f.attribute) == ("elbow_motor", "delay"))
    assert delay.unseen == (0.0, pytest.approx(0.004))


def test_the_file_says_delays_in_control_steps(planar, diagnosed, made):
    delay = made("input_delay", None, delay=Value(0.01, 0.001, "s"))
    content = yaml.safe_load(randomisation_text(randomisation_of(diagnosed(delay, bounds=UNSEEN[:2]), planar)))
    assert content["schema"] == "phantom-dyn-randomisation/2"
    assert content["control_step"] == 0.005
    (entry,) = content["found"]
    assert entry["range"] == [pytest.approx(0.008), pytest.approx(0.012)]
    assert entry["control_steps"] == [pytest.approx(1.6), pytest.approx(2.4)]
    assert [e["range"] for e in content["unseen"]] == [[0.0, 0.02], [-0.05, 0.05]]


def test_without_findings_and_bounds_the_file_is_empty_but_valid(planar, diagnosed):
    content = yaml.safe_load(randomisation_text(randomisation_of(diagnosed(), planar)))
    assert (content["found"], content["unseen"], content["mjcf"]) == ([], [], [])


def test_a_finding_of_one_recording_only_is_no_part_of_the_robot(planar, diagnosed, friction):
    own = replace(friction[0], recording="second.csv")
    assert randomisation_of(diagnosed(own, friction[1]), planar).findings == (friction[1],)


def test_an_unseen_payload_sits_where_its_bound_was_asked_for(planar, diagnosed):
    # At the joint's origin it would not swing at all, and would have been seen only where it is much heavier.
    bound = Bound("payload", None, "mass", 0.2, "kg")
    effect = unseen_effect(randomisation_of(diagnosed(bounds=(bound,)), planar), bound, 0.5)
    assert effect is not None
    np.testing.assert_allclose(effect.theta, [0.1, *planar.model.inertias[2].lever])


def test_an_unseen_spring_rests_at_the_mean_recorded_position(planar, diagnosed):
    bound, made = Bound("parasitic_spring", "elbow", "stiffness", 2.0, "N m/rad"), diagnosed()
    effect = unseen_effect(randomisation_of(made, planar), bound, 1.0)
    assert effect is not None
    assert effect.theta == (2.0, pytest.approx(np.mean(made.evidence.q[:, 1])))


def test_every_field_is_a_number_of_an_element_of_the_corrected_file(planar, diagnosed, friction):
    found = randomisation_of(diagnosed(*friction, bounds=UNSEEN), planar)
    root = ElementTree.fromstring(corrected_mjcf(corrected_model(planar, found.found)))
    names = {e.get("name") for e in root.iter()}
    assert {f.name for f in mjcf_ranges(found)[0]} <= names


@pytest.mark.parametrize("name", ["1e400", "nan"])
def test_the_name_of_a_robot_is_no_number_to_draw(tmp_path, diagnosed, friction, name):
    path = tmp_path / "robot.urdf"
    path.write_text((ROBOTS / "planar2.urdf").read_text().replace('<robot name="planar2">', f'<robot name="{name}">'))
    ranges = mjcf_ranges(randomisation_of(diagnosed(*friction), load_robot(path)))[0]
    assert {field.element for field in ranges} == {"joint"}


def test_a_spring_without_an_element_is_reported_instead_of_a_range_that_ends_at_no_stiffness(planar, diagnosed):
    content = yaml.safe_load(randomisation_text(randomisation_of(diagnosed(bounds=UNSEEN), planar)))
    assert content["mjcf_note"].endswith("under unseen: transmission_compliance on elbow.")


def test_a_field_says_what_mujoco_needs_beside_it(planar, diagnosed):
    found = randomisation_of(diagnosed(bounds=UNSEEN), planar)
    root = ElementTree.fromstring(corrected_mjcf(corrected_model(planar, ())))
    motor = next(e for e in root.iter("motor") if e.get("name") == "elbow_motor")
    bias = next(f for f in mjcf_ranges(found)[0] if f.attribute == "biasprm")
    motor.tag = bias.needs["element"]
    for key, text in bias.needs.items():
        if key != "element":
            motor.set(key, text)
    motor.set("biasprm", repr(bias.unseen[1]))
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator, [0.0, 0.05])


@pytest.fixture
def content(planar, diagnosed):
    """What the file says of some findings and bounds."""

    def read(*findings, bounds: tuple[Bound, ...] = ()) -> dict:
        return yaml.safe_load(randomisation_text(randomisation_of(diagnosed(*findings, bounds=bounds), planar)))

    return read


@pytest.fixture
def motion(planar, some) -> Motion:
    return some(planar)


def bound_of(effect: Effect, robot: Robot, motion: Motion, size: float) -> Bound:
    """What a diagnosis says of an effect that it has not seen."""
    joint = effect.places(robot)[-1]
    operation = Operation.of(robot, motion, temperature=np.full(motion.q.shape, 30.0))
    name, _ = effect.probe(robot, operation, joint)
    return Bound(effect.name, joint, name, size, effect.probe_unit(robot, joint, name))


# A limit of torque that was not seen has no size.
SIZED = [effect for effect in EFFECTS if effect.seen_by != "neither"]


@pytest.mark.parametrize("effect", SIZED, ids=lambda effect: effect.name)
def test_an_unseen_parameter_is_one_that_a_finding_has(effect, planar, content, motion):
    bound = bound_of(effect, planar, motion, 0.04)
    (entry,) = content(bounds=(bound,))["unseen"]
    units = {one.name: one.unit for one in effect.parameters(planar, bound.joint)}
    assert units[entry["parameter"]] == entry["unit"]
    low, high = entry["range"]
    assert low <= entry["nothing"] <= high
    assert low < high


@pytest.mark.parametrize("effect", SIZED, ids=lambda effect: effect.name)
def test_sizes_that_were_not_seen_fill_the_range_that_is_stated(effect, planar, diagnosed, content, motion):
    bound = bound_of(effect, planar, motion, 0.04)
    (entry,) = content(bounds=(bound,))["unseen"]
    drawn = randomisation_of(diagnosed(bounds=(bound,)), planar)
    names = [one.name for one in effect.parameters(planar, bound.joint)]
    place = names.index(entry["parameter"])
    if unseen_effect(drawn, bound, 1.0) is None:
        return
    shares = np.linspace(*unseen_sizes(planar, bound), 200)[1:-1] / bound.below
    values = np.array([unseen_effect(drawn, bound, share).theta[place] for share in shares])
    low, high = entry["range"]
    assert ((low <= values) & (values <= high)).all()
    # They reach both ends, but for one that is infinite.
    near = 0.1 * (high - low if np.isfinite(high) else low)
    assert values.min() < low + near
    assert values.max() > (high - near if np.isfinite(high) else 10.0 * low)


def test_a_ratio_of_torque_is_about_one_whether_it_was_found_or_not(made, content):
    # Closed form: one over one more or less the size.
    found = made("torque_constant", "shoulder", ratio=Value(1.10, 0.01, "1"))
    said = content(found, bounds=(Bound("torque_constant", "elbow", "ratio", 0.04, "1"),))
    assert said["found"][0]["range"] == pytest.approx([1.08, 1.12])
    assert said["unseen"][0]["range"] == pytest.approx([1 / 1.04, 1 / 0.96])
    assert said["unseen"][0]["nothing"] == 1.0


def test_a_ratio_that_may_be_off_by_more_than_itself_stays_within_what_can_be(content, planar):
    # Closed form: a torque that is 2.5 times as large at one end; at the other no ratio is large enough.
    (entry,) = content(bounds=(Bound("torque_constant", "elbow", "ratio", 1.5, "1"),))["unseen"]
    (ratio,) = effect_named("torque_constant").parameters(planar, "elbow")
    assert entry["range"] == pytest.approx([0.4, ratio.upper])


def test_a_compliance_that_was_not_seen_is_a_stiffness_as_a_finding_states_it(made, content):
    # Closed form: 0.001 rad/(N m) at most are 1000 N m/rad and more, and a rigid one is infinitely stiff.
    found = made("transmission_compliance", "shoulder", stiffness=Value(3000.0, 10.0, "N m/rad"))
    bound = Bound("transmission_compliance", "elbow", "compliance", 0.001, "rad/(N m)")
    said = content(found, bounds=(bound,))
    assert {(e["parameter"], e["unit"]) for e in (*said["found"], *said["unseen"])} == {("stiffness", "N m/rad")}
    assert said["unseen"][0]["range"] == [1000.0, np.inf]
    assert said["unseen"][0]["drawn_as"] == {"quantity": "1/stiffness", "unit": "rad/(N m)", "range": [0.0, 0.001]}


def test_the_file_says_what_its_numbers_count_from(planar, made, content):
    # By hand: what was found comes on top of what the model states, and the field of the file is both together.
    found = made("viscous_friction", "elbow", coefficient=Value(0.84, 0.01, "N m s/rad"))
    bound = Bound("viscous_friction", "shoulder", "coefficient", 0.02, "N m s/rad")
    said = content(found, bounds=(bound,))
    assert said["counts"] == {
        "adjusted": "on top of the given model",
        "found": "on top of the given model",
        "unseen": "on top of the given model",
        "mjcf": "absolute",
    }
    given = dict(zip(planar.joint_names, planar.viscous_friction.tolist(), strict=True))
    fields = {one["name"]: one for one in said["mjcf"] if one["attribute"] == "damping"}
    assert said["found"][0]["value"] == 0.84
    assert fields["elbow"]["value"] == pytest.approx(given["elbow"] + 0.84)
    assert said["unseen"][0]["range"] == [0.0, 0.02]
    assert fields["shoulder"]["unseen_range"] == pytest.approx([given["shoulder"], given["shoulder"] + 0.02])


def test_its_first_lines_say_so_in_words(planar, diagnosed):
    text = randomisation_text(randomisation_of(diagnosed(), planar))
    head = " ".join(word for line in text.splitlines() if line.startswith("#") for word in line[1:].split())
    assert "found: effects that the diagnosis found. They count on top of the given model" in head
    assert "unseen: effects that were not seen; they also count on top of the given model" in head
    assert "mjcf: the same as numbers of corrected.xml, absolute" in head


@pytest.fixture
def corrected(planar) -> CorrectedModel:
    found = (
        KnownEffect("coulomb_friction", "elbow", (0.7,)),
        KnownEffect("viscous_friction", "shoulder", (0.3,)),
        KnownEffect("rotor_inertia", "elbow", (0.05,)),
        KnownEffect("torque_saturation", "shoulder", (9.0,)),
        KnownEffect("input_delay", "elbow", (0.0101,)),
        KnownEffect("parasitic_spring", "elbow", (3.0, 0.2)),
        KnownEffect("backlash", "elbow", (0.04,)),
    )
    return corrected_model(planar, found)


class _Cfg:
    """Stands for DelayedPDActuatorCfg: it keeps what it is given."""

    def __init__(self, **fields):
        self.fields = fields


@pytest.fixture
def groups(corrected, monkeypatch):
    package, actuators = ModuleType("isaaclab"), ModuleType("isaaclab.actuators")
    actuators.DelayedPDActuatorCfg = _Cfg  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "isaaclab", package)
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", actuators)
    scope: dict = {}
    exec(compile(isaac_lab_text(corrected, "arm"), "isaac_lab.py", "exec"), scope)
    return scope["actuators"](0.005, 40.0, {"shoulder": 1.0, "elbow": 2.0})


def test_friction_rotors_and_limits_of_isaac_lab_are_the_corrected_ones(groups, planar):
    elbow, shoulder = groups["elbow"].fields, groups["shoulder"].fields
    assert elbow["friction"] == elbow["dynamic_friction"] == pytest.approx(planar.coulomb_friction[1] + 0.7)
    assert elbow["armature"] == pytest.approx(planar.rotor_inertia[1] + 0.05)
    assert shoulder["viscous_friction"] == pytest.approx(planar.viscous_friction[0] + 0.3)
    assert shoulder["effort_limit"] == 9.0
    assert elbow["effort_limit"] == 20.0  # as its URDF states


def test_a_delay_is_in_whole_physics_steps_of_its_joint_alone(groups):
    delays = {joint: (group.fields["min_delay"], group.fields["max_delay"]) for joint, group in groups.items()}
    assert delays == {"shoulder": (0, 0), "elbow": (2, 2)}


def test_gains_are_those_that_the_user_gives(groups):
    assert (groups["elbow"].fields["stiffness"], groups["elbow"].fields["damping"]) == (40.0, 2.0)


def test_what_isaac_lab_cannot_say_is_in_the_docstring(corrected):
    said = " ".join(str(ast.get_docstring(ast.parse(isaac_lab_text(corrected, "arm")))).split())
    assert "Isaac Lab has no place for play: elbow 0.04." in said
    assert "Isaac Lab has no place for spring: elbow 3." in said
    assert "no place for delay" not in said


def test_a_name_with_quotes_leaves_a_file_that_python_reads(corrected):
    assert ast.parse(isaac_lab_text(corrected, 'an "arm" """\\'))


def test_each_section_has_the_numbers_that_its_simulator_holds(corrected, planar):
    found = yaml.safe_load(simulators_text(corrected, "arm"))
    friction = pytest.approx(planar.coulomb_friction[1] + 0.7)
    elbow = found["gazebo"]["joints"]["elbow"]
    assert (elbow["friction"], elbow["spring_stiffness"], elbow["spring_reference"]) == (friction, 3.0, 0.2)
    assert found["drake"]["joints"]["elbow"]["rotor_inertia"] == pytest.approx(planar.rotor_inertia[1] + 0.05)
    assert found["ros2_control"]["joint_limits"]["shoulder"] == {"has_effort_limits": True, "max_effort": 9.0}


def test_limits_of_the_given_file_are_there_where_none_was_found(corrected):
    # Oracle: the effort of planar2.urdf.
    found = yaml.safe_load(simulators_text(corrected, "arm"))
    assert found["ros2_control"]["joint_limits"]["elbow"] == {"has_effort_limits": True, "max_effort": 20.0}
    assert [found[name]["joints"]["elbow"]["effort"] for name in ("gazebo", "drake")] == [20.0, 20.0]


def test_each_section_says_what_it_has_no_place_for(corrected):
    found = yaml.safe_load(simulators_text(corrected, "arm"))
    assert any("Drake has no place for Coulomb friction" in s and "elbow" in s for s in found["drake"]["cannot_say"])
    assert "Gazebo (SDF) has no place for delay: elbow 0.0101." in found["gazebo"]["cannot_say"]
    assert any("ros2_control has no place for viscous friction" in s for s in found["ros2_control"]["cannot_say"])


def test_a_late_reference_is_the_delay_of_the_command_in_isaac_lab(planar, monkeypatch):
    package, actuators = ModuleType("isaaclab"), ModuleType("isaaclab.actuators")
    actuators.DelayedPDActuatorCfg = _Cfg  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "isaaclab", package)
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", actuators)
    late = corrected_model(planar, (KnownEffect("reference_delay", None, (0.03,)),))
    scope: dict = {}
    exec(compile(isaac_lab_text(late, "arm"), "isaac_lab.py", "exec"), scope)
    groups = scope["actuators"](0.005, 40.0, 1.0)
    # By hand: six steps of 5 ms.
    assert {name: group.fields["min_delay"] for name, group in groups.items()} == {"shoulder": 6, "elbow": 6}
