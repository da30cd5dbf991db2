"""A gain or a load: torque that was asked for, place of a payload."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import yaml

from benchmarks.motion_only import SAME, case, in_set
from by_night import by_night
from identification.data.changes import Change, KnownPayload, robot_in
from identification.data.checks.readings.stated_payloads import with_payloads_checked
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.diagnosis.result import Bound, Diagnosis, Finding, Judgement, Value
from identification.notes import Code, Note
from identification.pipeline import diagnose
from identification.rollout.compare import Rollout
from identification.scenarios.gain_ambiguities import without_gain_ambiguities
from identification.scenarios.gain_or_load import preferred_diagnosis, scales_by_friction, with_scaled_gains
from identification.scenarios.motion_only import limited_controller_torque, states_controllers, with_controller_torque
from identification.scenarios.recordings_file import read_changes
from identification.words.note_words import sentence
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.support.changed_robot import with_rotor_inertia
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator, Controller, Robot
from phantom_dyn.motion import Motion

KP = 40.0


@pytest.fixture
def driven(pendulum) -> Robot:
    """A pendulum with 0.3 N m s/rad and 0.7 N m of modelled friction, and a gain that was estimated."""
    return replace(pendulum, actuators=(Actuator(controller=Controller(kp=KP, kd=0.1)),))


@pytest.fixture
def estimated(driven) -> Recording:
    t = np.arange(200) / 100.0
    q = 0.5 * np.sin(t)[:, None]
    log = Recording("log.csv", ("pin",), t, q, None, q_ref=q + 0.01, gains_estimated=("pin",), controlled=True)
    return replace(log, warnings=("other",), notes=(Note(Code.GAINS_ESTIMATED, "pin"),))


def friction(made_up, effect: str, parameter: str, value: float) -> Finding:
    finding = made_up(joints=("pin",)).findings[0]
    return replace(finding, effect=effect, joint="pin", parameters={parameter: Value(value, 0.01, "1")}, rivals=())


def less(made_up, value: float = -0.2) -> Finding:
    return friction(made_up, "viscous_friction", "coefficient", value)


def test_the_scale_is_the_modelled_friction_over_what_is_left_of_it(made_up, driven, estimated):
    # By hand: of 0.3 N m s/rad 0.2 are missing beyond what a gain of 0.1 gave back: 0.3 / 0.2.
    assert scales_by_friction(driven, (estimated,), (less(made_up),)) == pytest.approx({"pin": 1.5})
    dry = friction(made_up, "coulomb_friction", "torque", -0.35)
    assert scales_by_friction(driven, (estimated,), (dry,)) == pytest.approx({"pin": 2.0})


@pytest.mark.parametrize("value", [0.2, -0.39])
def test_more_friction_than_modelled_or_next_to_none_says_nothing_of_the_scale(made_up, driven, estimated, value):
    assert scales_by_friction(driven, (estimated,), (less(made_up, value),)) == {}


def test_a_gain_that_was_stated_is_not_scaled(made_up, driven, estimated):
    stated = replace(estimated, gains_estimated=())
    assert scales_by_friction(driven, (stated,), (less(made_up),)) == {}


def test_the_torque_of_a_higher_gain_is_as_many_times_larger(driven, estimated):
    robot, (recording,) = with_scaled_gains(driven, (estimated,), {"pin": 1.5})
    plain = replace(driven, actuators=(Actuator(controller=Controller(kp=KP, kd=0.0)),))
    np.testing.assert_allclose(recording.tau, 1.5 * limited_controller_torque(estimated, plain))
    controller = robot.actuators[0].controller
    assert controller is not None
    assert (controller.kp, controller.kd) == (60.0, 0.0)


def test_the_warning_names_both_gains_in_place_of_the_old_one(driven, estimated):
    _, (recording,) = with_scaled_gains(driven, (estimated,), {"pin": 1.5})
    other, note = recording.remarks
    assert (other, note.code) == ("other", Code.GAIN_BY_FRICTION)
    words = sentence(note)
    assert (
        "kp is 40 N m/rad, and the joint would have less friction than the model states. With kp = 60 N m/rad" in words
    )


def readings(made_up, left: tuple[float, float]) -> tuple[Diagnosis, Diagnosis]:
    """A diagnosis with less friction and one with a payload, which leave so many floors each."""
    made = made_up(joints=("pin",))
    gap = made.joints[0]
    load = replace(less(made_up), effect="payload", joint=None, parameters={"mass": Value(1.0, 0.1, "kg")})
    return tuple(
        replace(
            made,
            findings=(replace(finding, probability=1.0, rivals=()),),
            joints=(replace(gap, rms_after=floors * gap.noise_floor),),
            evidence=replace(
                made.evidence,
                tau_after=made.evidence.tau_measured
                + floors * gap.noise_floor * np.ones_like(made.evidence.tau_measured),
            ),
        )
        for finding, floors in zip((less(made_up), load), left, strict=True)
    )  # pyright: ignore[reportReturnType]


@pytest.mark.parametrize(("left", "leads"), [((1.2, 1.1), True), ((1.1, 1.2), False)])
def test_what_noise_alone_separates_stays_in_the_set(made_up, left, leads):
    second_leads, found = preferred_diagnosis(*readings(made_up, left), {})
    (finding,) = found.findings
    (rival,) = finding.rivals
    assert second_leads is leads
    assert {finding.effect, rival.effects[0].effect} == {"payload", "viscous_friction"}
    assert (finding.probability, rival.probability, finding.verdict) == (0.5, 0.5, "one_of")


@pytest.mark.parametrize(("left", "effect"), [((5.0, 1.1), "payload"), ((1.1, 5.0), "viscous_friction")])
def test_a_reading_that_leaves_a_gap_is_ruled_out(made_up, left, effect):
    _, found = preferred_diagnosis(*readings(made_up, left), {})
    (finding,) = found.findings
    assert (finding.effect, finding.rivals) == (effect, ())


def test_torques_of_the_second_are_compared_at_the_scale_of_the_first(made_up):
    # By hand: twice as large torques that leave four times as much leave twice as much.
    first, second = readings(made_up, (3.0, 4.0))
    assert [preferred_diagnosis(first, second, {"pin": scale})[0] for scale in (1.0, 2.0)] == [False, True]


@pytest.mark.whole
@pytest.mark.parametrize(
    ("truth", "seed"), by_night([("payload", 0), ("payload", 3), ("less_friction", 0), ("nothing", 0)], 0, 2, 3)
)
def test_the_truth_is_in_the_set_without_a_gain(truth, seed):
    one = case(truth, np.random.default_rng([seed, list(SAME).index(truth)]))
    silent = replace(one.robot, actuators=(Actuator(),))
    found = diagnose(silent, (one.recording,), motion_only=True)
    assert in_set(found, truth)
    if (truth, seed) == ("payload", 0):
        assert found.driven is not None
        controller = found.driven.actuators[0].controller
        assert controller is not None
        assert controller.kp == pytest.approx(60.0, rel=0.08)


def test_a_load_is_not_ruled_out_where_the_gain_was_estimated(made_up, driven, estimated):
    made = made_up(joints=("pin",), findings=0)
    bounds = tuple(
        Bound(effect, joint, "x", 0.1, "kg", 0.1) for effect, joint in (("payload", None), ("cogging", "pin"))
    )
    shared = {name: getattr(made, name) for name in ("joints", "adjusted", "unexplained", "evidence")}
    judgement = Judgement("no_gap", findings=(), bounds=bounds, not_testable=(), **shared)
    found = without_gain_ambiguities(judgement, (estimated,), Rollout(None, {}, {}), driven)
    assert [bound.effect for bound in found.bounds] == ["cogging"]
    (why,) = (entry.why for entry in found.not_testable if entry.effect == "payload")
    assert "a load that changes weight and inertia of a joint alike makes it higher" in why
    stated = without_gain_ambiguities(
        judgement, (replace(estimated, gains_estimated=()),), Rollout(None, {}, {}), driven
    )
    assert [bound.effect for bound in stated.bounds] == ["payload", "cogging"]


@pytest.fixture
def held(pendulum):
    """The pendulum under known gains."""
    return robot_in(pendulum, Change("a.csv", controllers={"pin": Controller("pd", 40.0, 2.0)}))


@pytest.fixture
def without_torque(pendulum):
    t = np.arange(500) / 100.0
    return Recording("a.csv", pendulum.joint_names, t, np.sin(t)[:, None], None, q_ref=np.sin(t + 0.1)[:, None])


def test_the_torque_is_what_the_controllers_asked_for(held, without_torque):
    # Closed form, but for the ends, where differences are one-sided.
    t = without_torque.t
    found = with_controller_torque(without_torque, held)
    assert found.tau is not None
    wanted = 40.0 * (np.sin(t + 0.1) - np.sin(t)) - 2.0 * np.cos(t)
    np.testing.assert_allclose(found.tau[1:-1, 0], wanted[1:-1], atol=1e-4)
    assert "the torque is what its controllers asked for" in sentence(found.notes[-1])
    assert found.controlled


def test_a_recorded_torque_stays(held, without_torque):
    measured = replace(without_torque, tau=np.ones((500, 1)))
    assert with_controller_torque(measured, held) is measured


def test_without_references_there_is_no_torque(held, without_torque):
    with pytest.raises(LogError, match=r"a\.csv has neither torque nor references: add tau"):
        with_controller_torque(replace(without_torque, q_ref=None), held)


def test_controllers_that_ask_for_nothing_are_refused(held, without_torque):
    still = replace(without_torque, q=np.zeros((500, 1)), q_ref=np.zeros((500, 1)))
    with pytest.raises(LogError, match="ask for no torque at all"):
        with_controller_torque(still, held)


def test_a_robot_states_controllers_only_if_every_drive_has_one(pendulum, held):
    assert states_controllers(held)
    assert not states_controllers(pendulum)


LINK = """<link name="{0}"><inertial><origin xyz="{2}"/><mass value="{1}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""

TIP = """<link name="tip"/><joint name="to_tip" type="fixed"><parent link="{0}"/><child link="tip"/>
<origin xyz="0.1 0 -0.35" rpy="0 0.6 0"/></joint>"""

TROLLEY = f"""<robot name="trolley"><link name="rail"/>{LINK.format("cart", 2.0, "0 0 0")}
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="100" velocity="5"/><dynamics damping="0.5" friction="0.5"/></joint>
{LINK.format("rod", 0.8, "0 0 -0.2")}
<joint name="swing" type="revolute"><parent link="cart"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="30" velocity="8"/><dynamics damping="0.05" friction="0.05"/></joint>
{TIP.format("rod")}</robot>"""

LEVER = f"""<robot name="lever"><link name="wall"/>{LINK.format("beam", 1.4, "0.05 0 -0.25")}
<joint name="hinge" type="revolute"><parent link="wall"/><child link="beam"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="60" velocity="12"/></joint>{TIP.format("beam")}</robot>"""


def moving(rows, seed, seconds=14.0, size=1.0):
    """Three sines of known derivatives at 100 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(100 * seconds)) / 100.0
    w = 2 * np.pi * np.array([0.23, 0.61, 1.13])
    angle = t[:, None, None] * w + rng.uniform(0, 2 * np.pi, (rows, 3))
    part = size * rng.uniform(0.3, 0.5, (rows, 3)) / (1 + w / (2 * np.pi))
    columns = part * np.sin(angle), part * w * np.cos(angle), -part * w**2 * np.sin(angle)
    return Motion(t, *(column.sum(axis=2) for column in columns))


def written(folder, name, robot, motion, *, ball=None, scale=1.0, seed=0):
    """A log of a robot that carries a ball, its mass and its centre in the frame of a name; the torque is scaled."""
    model = robot.model.copy()
    if ball is not None:
        mass, center, frame = ball
        at = model.frames[model.getFrameId(frame)]
        point = pin.Inertia(mass, np.array(center), np.zeros((3, 3)))
        model.appendBodyToJoint(at.parentJoint, point, at.placement)
    rng = np.random.default_rng([3, seed])
    tau = scale * inverse_dynamics(replace(robot, model=model), motion)
    tau = tau + 0.01 * rng.standard_normal(tau.shape)
    table = np.column_stack([motion.t, motion.q + 1e-5 * rng.standard_normal(tau.shape), tau])
    head = ["t", *(f"{kind}.{joint}" for kind in ("q", "tau") for joint in robot.joint_names)]
    np.savetxt(folder / name, table, delimiter=",", header=",".join(head), comments="")
    return folder / name


def loaded(folder, urdf, config=""):
    """The robot of a URDF and of a ``robot.yaml``."""
    (folder / "robot.urdf").write_text(urdf)
    (folder / "robot.yaml").write_text(config)
    return load_robot(folder / "robot.urdf")


def together(robot, logs, changes):
    """The diagnosis of logs and of what a ``recordings.yaml`` says."""
    known = read_changes(changes, logs, robot.joint_names)
    return diagnose(robot, tuple(read_recording(log, robot) for log in logs), changes=known)


@pytest.mark.whole
@pytest.mark.parametrize(("config", "frame"), by_night([("", "swing"), ("payload_frame: tip", "tip")], 1))
def test_a_known_payload_where_the_file_says_is_no_gap(tmp_path, config, frame):
    # A frame called tip counts where it is stated, and the joint where none is.
    robot = loaded(tmp_path, TROLLEY, config)
    ball = (0.4, (0.05, 0.0, -0.3), frame)
    logs = (
        written(tmp_path, "bare.csv", robot, moving(2, 1)),
        written(tmp_path, "held.csv", robot, moving(2, 2), ball=ball, seed=1),
    )
    changes = tmp_path / "recordings.yaml"
    changes.write_text("recordings:\n  - {file: held.csv, payload: {mass: 0.4, center: [0.05, 0, -0.3]}}\n")
    assert together(robot, logs, changes).verdict == "no_gap"


@pytest.mark.parametrize(
    ("entry", "mend"),
    [
        ("mass: 0.4, center: [-0.3, 0, 0.05]", r"write center: \[0.05, 0, -0.3\], if the axes are so"),
        ("mass: 0.882, center: [0.05, 0, -0.3]", r"write mass: 0.4, if it is in pounds"),
        ("mass: 3, center: [0.3, 0, 0.5]", r"correct its mass \[kg\] and centre \[m\]"),
    ],
)
def test_a_stated_payload_that_the_torques_contradict_is_refused(tmp_path, entry, mend):
    # Oracle: the given model explains bare.csv; in held.csv it holds a ball of 0.4 kg at (0.05, 0, -0.3) m.
    robot = loaded(tmp_path, TROLLEY)
    ball = (0.4, (0.05, 0.0, -0.3), "swing")
    logs = (
        written(tmp_path, "bare.csv", robot, moving(2, 1)),
        written(tmp_path, "held.csv", robot, moving(2, 2), ball=ball, seed=1),
    )
    changes = tmp_path / "recordings.yaml"
    changes.write_text(f"recordings:\n  - {{file: held.csv, payload: {{{entry}}}}}\n")
    with pytest.raises(LogError, match=r"held\.csv: its payload is not the stated one of .*" + mend):
        together(robot, logs, changes)


@pytest.mark.whole
def test_the_centre_that_a_finding_prints_is_no_gap_in_the_next_diagnosis(tmp_path):
    robot = loaded(tmp_path, TROLLEY)
    ball = (0.4, (0.05, 0.0, -0.3), "swing")
    held = written(tmp_path, "held.csv", robot, moving(2, 2), ball=ball, seed=1)
    (found,) = diagnose(robot, (read_recording(held, robot),)).findings
    assert found.effect == "payload"
    # The arm is planar, so that nothing shows the centre's place along the axis.
    # The mass shows by the trolley's inertia alone, which a rotor makes as well, so that moments are stated beside it.
    mass, *moments = (found.parameters[name].value for name in ("mass", "moment_x", "moment_z"))
    x, z = (moment / mass for moment in moments)
    changes = tmp_path / "recordings.yaml"
    changes.write_text(f"recordings: [{{file: held.csv, payload: {{mass: {mass}, center: [{x}, 0, {z}]}}}}]")
    bare = written(tmp_path, "bare.csv", robot, moving(2, 1))
    assert together(robot, (bare, held), changes).verdict == "no_gap"


def test_a_right_payload_beside_rotors_that_the_model_lacks_is_not_refused(tmp_path):
    # Known truth: rotors, which a bare recording at a quarter of the speed hardly shows.
    robot = loaded(tmp_path, TROLLEY)
    with_rotors = with_rotor_inertia(with_rotor_inertia(robot, "swing", 0.2), "slide", 2.0)
    m, ball = moving(2, 1), (0.4, (0.05, 0.0, -0.3), "swing")
    logs = (
        written(tmp_path, "bare.csv", with_rotors, Motion(4 * m.t, m.q, m.v / 4, m.a / 16)),
        written(tmp_path, "held.csv", with_rotors, moving(2, 2), ball=ball, seed=1),
    )
    changes = (Change("bare.csv"), Change("held.csv", KnownPayload(ball[0], ball[1])))
    recordings = tuple(replace(read_recording(log, robot), wrong=()) for log in logs)
    assert [one.wrong for one in with_payloads_checked(robot, recordings, changes)] == [(), ()]


NUMBER = r"(-?[0-9][0-9.e-]*)"


@pytest.mark.whole
@pytest.mark.parametrize("config", by_night(["", "payload_frame: tip"], 1))
def test_the_proposed_experiment_done_to_the_letter_names_the_truth(tmp_path, plan, config):
    # Known truth: the drive gives 0.8 of its torque. Without friction a load explains one recording as well.
    robot = loaded(tmp_path, LEVER, config)
    first = written(tmp_path, "first.csv", robot, moving(1, 5), scale=1.25)
    found = diagnose(robot, (read_recording(first, robot),))
    rivals = {at.effect for one in found.findings for rival in one.rivals for at in rival.effects}
    assert {"payload", "torque_constant"} <= rivals | {one.effect for one in found.findings}
    assert found.next_experiment is not None
    assert found.next_motion is not None
    say = found.next_experiment["say"]
    asked = re.search(rf"a known mass of {NUMBER} kg at \({NUMBER}, {NUMBER}, {NUMBER}\) m of (.*?) \(", say)
    entry = re.search(r"write (payload: \{.*?\}) beside its file name in recordings\.yaml", say)
    assert asked is not None
    assert entry is not None
    mass, *center = (float(word) for word in asked.groups()[:4])
    place = asked.group(5).rsplit(" ", 1)[1]
    assert place == ("tip" if config else "hinge")
    second = written(tmp_path, "second.csv", robot, found.next_motion, ball=(mass, center, place), scale=1.25, seed=1)
    changes = tmp_path / "recordings.yaml"
    changes.write_text(yaml.safe_dump({"recordings": [{"file": "second.csv"} | yaml.safe_load(entry.group(1))]}))
    after = together(robot, (first, second), changes)
    (finding,) = after.findings
    assert (finding.effect, finding.rivals) == ("torque_constant", ())
    assert finding.parameters["ratio"].value == pytest.approx(0.8, abs=0.01)
