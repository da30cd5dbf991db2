"""Resonances, one sine, and readings at standstill."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.servo_cases import case
from identification.data.log import Log
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.data.signals import process, process_all
from identification.diagnosis.columns.motion.one_sine import in_one_sine, moving, uninformative_sines
from identification.diagnosis.columns.motion.standstill import standing_still
from identification.diagnosis.columns.operations import adjusted_robot
from identification.diagnosis.columns.resonances import resonances
from identification.diagnosis.columns.session import session_of
from identification.diagnosis.columns.tolerance_parameters import tolerance_parameters
from identification.notes import Code, Note
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import write_outputs
from phantom_dyn.haptics.device.axis import TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.experiments.relay import held_forces
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS

T = 1e-3

# Rotor 0.05 and link 0.2 kg m2 on 800 N m/rad: they resonate at 22.5 Hz.
JOINT = TwoMassAxis(0.05, 0.2, 0.1, 0.2, 800.0, 0.3)

ROBOT = """<robot name="turntable"><link name="base"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="table"/><axis xyz="0 0 1"/>
<dynamics damping="0.3"/></joint>
<link name="table"><inertial><mass value="2"/><inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/>
</inertial></link></robot>"""


@pytest.fixture
def turntable(tmp_path: Path) -> Robot:
    """The joint as a rigid robot."""
    (tmp_path / "turntable.urdf").write_text(ROBOT)
    (tmp_path / "robot.yaml").write_text("torque_hold: zoh\njoints:\n  j1: {rotor_inertia: 0.05}\n")
    return load_robot(tmp_path / "turntable.urdf")


def driven(noise: float) -> Recording:
    """Twenty seconds of the joint under two slow sines of torque and white noise of that deviation [N m]."""
    rng = np.random.default_rng(3)
    t = T * np.arange(20_000)
    force = noise * rng.standard_normal(len(t)) + 2.0 * np.sin(0.8 * np.pi * t) + np.sin(2.2 * np.pi * t + 1.0)
    s = discretise(JOINT, period=T, delay=0.0)
    q = held_forces(s.transition, s.newer, s.older, s.output, s.steps, JOINT.rest(0.0), force, 0.0)
    q = q + 1e-5 * rng.standard_normal(len(t))
    return Recording("noise.csv", ("j1",), t, q[:, None], force[:, None])


def test_a_resonance_that_the_drive_excites_gives_the_stiffness(turntable):
    (seen,) = resonances(turntable, process_all((driven(0.5),), turntable)[0])
    assert seen.effect_joint == ("transmission_compliance", "j1")
    assert 1.0 / seen.shape[0] == pytest.approx(800.0, rel=0.01)


def test_a_smooth_torque_shows_no_resonance(turntable):
    assert resonances(turntable, process_all((driven(0.0),), turntable)[0]) == ()


def test_an_encoder_behind_the_spring_is_not_asked(turntable):
    (actuator,) = turntable.actuators
    behind = replace(turntable, actuators=(replace(actuator, encoder_side="link"),))
    assert resonances(behind, process_all((driven(0.5),), behind)[0]) == ()


@pytest.mark.whole
def test_the_diagnosis_names_the_spring_with_its_stiffness(turntable):
    # Known truth, within three standard deviations.
    (finding,) = diagnose(turntable, (driven(0.5),)).findings
    assert (finding.effect, finding.joint) == ("transmission_compliance", "j1")
    stiffness = finding.parameters["stiffness"]
    assert np.abs(np.subtract(stiffness.value, 800.0)) < np.multiply(3.0, stiffness.std)


def swung(robot, *hertz: float, edge_hz: float = 5.0) -> Log:
    t = np.arange(4000) / 200.0
    q = sum(0.3 * np.sin(2 * np.pi * f * t) for f in hertz)[:, None]
    log = process(Recording("bench.csv", robot.joint_names, t, q, np.cos(q)), robot)
    return replace(log, band=replace(log.band, cutoff_hz=edge_hz))


def few(*logs: Log) -> list[bool]:
    return uninformative_sines(logs, moving(logs))[:, 0].tolist()


@pytest.mark.parametrize(("hertz", "harmonic_is_seen"), [(1.6, True), (1.8, False)])
def test_a_sine_without_its_third_harmonic_is_not_judged_beside_more(pendulum, hertz, harmonic_is_seen):
    # A square wave of friction has lines at 1, 3, 5 times its frequency; the band ends at 5 Hz.
    assert few(swung(pendulum, hertz), swung(pendulum, 0.5, 1.3)) == [not harmonic_is_seen, False]


def test_a_sine_is_judged_where_there_is_nothing_else(pendulum):
    assert few(swung(pendulum, 1.8), swung(pendulum, 2.1)) == [False, False]


def test_a_recording_in_which_a_joint_rests_is_no_other_motion(pendulum):
    logs = (swung(pendulum, 1.8), at_rest(swung(pendulum, 1.8)))
    assert few(*logs) == [False, False]
    assert in_one_sine(logs, moving(logs)) == {0}


def at_rest(log: Log) -> Log:
    """The same log with its joint at rest."""
    still = np.zeros_like(log.motion.q)
    return replace(log, motion=replace(log.motion, q=still, v=still, a=still))


def still(q: np.ndarray, rate: float) -> np.ndarray:
    """Share of the samples in which each joint counts as standing."""
    robot = load_robot(ROBOTS / "planar2.urdf")
    t = np.arange(len(q)) / rate
    tau = np.sin(1.3 * t)[:, None] * np.ones(2)
    log = process(Recording("log.csv", robot.joint_names, t, q, tau), robot)
    return standing_still(log)[log.valid].mean(axis=0)


def swings(t: np.ndarray, *hertz: float) -> np.ndarray:
    return sum(np.sin(2 * np.pi * f * t + f) / f for f in hertz) * np.ones((2, 1))


@pytest.mark.parametrize(("rate", "hertz"), [(20.0, (0.9, 1.5, 2.1)), (200.0, (0.6, 1.7)), (30.0, (1.1, 2.9))])
def test_motion_without_a_rest_is_no_standstill(rng, rate, hertz):
    t = np.arange(0, 40, 1 / rate)
    q = 0.3 * swings(t, *hertz).T + 2e-6 * rng.standard_normal((len(t), 2))
    assert still(q, rate).max() < 0.2


@pytest.mark.parametrize("rate", [25.0, 200.0])
def test_a_joint_that_is_held_stands_beside_one_that_moves(rng, rate):
    t = np.arange(0, 40, 1 / rate)
    q = 0.3 * swings(t, 0.7, 1.9).T
    q[:, 1] = 0.4
    found = still(q + 1e-4 * rng.standard_normal((len(t), 2)), rate)
    assert found[0] < 0.2
    assert found[1] > 0.9


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """Case, robot and recording of a servo with a load, and its diagnosis."""
    one = case("load measured", 402)
    urdf, config, log = one.write(tmp_path_factory.mktemp("servo"))
    robot = load_robot(urdf, config=config)
    recording = read_recording(log, robot)
    return one, robot, recording, diagnose(robot, (recording,))


@pytest.mark.whole
def test_a_load_is_found_alone(loaded):
    # The line through the readings alone makes viscous friction of 0.11 N m s/rad of it, and half of the load.
    one, _, _, found = loaded
    assert [finding.effect for finding in found.findings] == ["payload"]
    assert found.findings[0].parameters["mass"].value == pytest.approx(one.truth["payload"], rel=0.05)


@pytest.mark.whole
def test_the_corrected_model_follows_the_motion(loaded):
    *_, found = loaded
    assert found.rollout["rms_after"]["j0"] < 0.01 * found.rollout["rms_before"]["j0"]


@pytest.mark.whole
def test_that_friction_looks_the_same_is_said(loaded):
    *_, found = loaded
    assert Code.OPEN_ARRIVAL in {note.code for note in found.notes if isinstance(note, Note)}


@pytest.mark.whole
def test_files_say_that_the_readings_are_no_mean(loaded, tmp_path: Path):
    _, robot, _, found = loaded
    write_outputs(found, robot, out=tmp_path, json_file=None)
    assert "was read at one time while each reference was held" in (tmp_path / "corrected.yaml").read_text(
        encoding="utf-8"
    )


@pytest.mark.whole
def test_when_references_arrive_changes_no_model(loaded):
    _, robot, recording, _ = loaded
    session = session_of(robot, (recording,))
    values = np.array(
        [0.4 if parameter.kind == "arrival" else 0.0 for parameter in tolerance_parameters(session.robot)]
    )
    moved = adjusted_robot(session.robot, values)
    assert values.any()
    assert moved.viscous_friction.tolist() == session.robot.viscous_friction.tolist()
    assert moved.rotor_inertia.tolist() == session.robot.rotor_inertia.tolist()


@pytest.mark.whole
def test_a_perfect_servo_has_no_friction(tmp_path: Path):
    urdf, config, log = case("null measured", 401).write(tmp_path)
    robot = load_robot(urdf, config=config)
    assert diagnose(robot, (read_recording(log, robot),)).findings == ()
