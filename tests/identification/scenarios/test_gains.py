"""Gains, loads and held references of a controller."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.servo_cases import case
from by_night import by_night
from identification.data.drive_loop import DriveLoop
from identification.data.drives.joint_torque import per_speed, per_volt
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.data.signals import process
from identification.diagnosis.columns.session import session_of
from identification.notes import Note
from identification.pipeline import diagnose
from identification.scenarios.gains import Gains, estimated_gains, joints_without_stated_gains, with_estimated_gains
from identification.scenarios.motion_only import commanded_robot, states_controllers, with_commanded_torque
from identification.scenarios.protected_drives import protection_notes
from identification.scenarios.torque_or_motion import driven_by_controllers, torque_or_motion
from identification.words.note_words import sentence, sentences
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.changed_robot import with_gravity, with_parameters
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator, Controller, Robot
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate
from places import ROBOTS

KP, KD = np.array([60.0, 25.0]), np.array([6.0, 1.5])


@pytest.fixture(scope="module")
def planar() -> Robot:
    """Two links on shoulder and elbow."""
    return load_robot(ROBOTS / "planar2.urdf")


def moved(robot: Robot, *causes: Cause, slower: float = 1.0, file: str = "moved.csv") -> Recording:
    """15 s at 200 Hz of references and positions, no torque."""
    rng = np.random.default_rng(3)
    t, n = np.arange(3000) / 200.0, robot.nv
    w = 2 * np.pi / slower * np.array([[0.21, 0.53, 1.1], [0.27, 0.71, 1.3]])[:n]
    phase = np.array([[0.3, 1.2, 2.5], [1.0, 0.1, 0.7]])[:n]
    q_ref = (np.array([0.6, 0.4, 0.25]) * np.sin(t[:, None, None] * w + phase)).sum(axis=2)
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=KP[:n], kd=KD[:n])
    q = simulate(robot, causes, law, t, q_ref[0]).q + 1e-5 * rng.standard_normal(q_ref.shape)
    return Recording(file, robot.joint_names, t, q, None, q_ref=q_ref)


def cause(effect: str, joint: str | None, *theta: float) -> Cause:
    return Cause(effect_named(effect), joint, np.array(theta))


def read(*recordings: Recording) -> Callable[[bool], tuple[Recording, ...]]:
    return lambda torque_needed: recordings


@pytest.fixture(scope="module")
def swung(pendulum) -> Recording:
    return moved(pendulum)


@pytest.fixture(scope="module")
def of_both(planar) -> tuple[Gains, ...]:
    return estimated_gains((moved(planar),), planar)


@pytest.mark.parametrize("j", [0, 1])
def test_gains_of_both_joints_are_those_that_moved_the_arm(of_both, j):
    assert of_both[j].known
    assert of_both[j].kp == pytest.approx(KP[j], rel=0.02)
    assert of_both[j].kd == pytest.approx(KD[j], rel=0.05)
    assert of_both[j].kp_std < 0.02 * KP[j]


def test_friction_that_the_model_lacks_is_not_taken_for_a_gain(pendulum):
    (found,) = estimated_gains((moved(pendulum, cause("coulomb_friction", "pin", 1.0)),), pendulum)
    assert found.kp == pytest.approx(KP[0], rel=0.02)


def test_viscous_friction_that_the_model_lacks_is_part_of_the_damping_gain(pendulum):
    # Closed form: both are torques of -c v.
    (found,) = estimated_gains((moved(pendulum, cause("viscous_friction", "pin", 2.0)),), pendulum)
    assert found.kd == pytest.approx(KD[0] + 2.0, rel=0.05)


def test_positions_alone_tell_the_ratio_of_the_gains(pendulum):
    # Closed form: without friction, twice the masses need twice the gains for the same motion.
    free = replace(pendulum, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))
    recording = moved(free)
    (one,) = estimated_gains((recording,), free)
    (twice,) = estimated_gains((recording,), with_parameters(free, standard_parameters(free)))
    assert twice.kp == pytest.approx(2.0 * one.kp, rel=1e-6)
    assert twice.ratio == pytest.approx(one.ratio, rel=1e-6)
    assert one.ratio == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize(
    ("weightless", "slower", "determined_by"), [(False, 3.0, ("gravity",)), (True, 1.0, ("inertia",))]
)
def test_it_is_said_what_of_the_model_sets_the_scale(pendulum, weightless, slower, determined_by):
    # By hand: a slow pendulum is moved against its weight, one without weight against its inertia.
    robot = with_gravity(pendulum, np.zeros(3)) if weightless else pendulum
    (found,) = estimated_gains((moved(robot, slower=slower),), robot)
    assert found.determined_by == determined_by


def test_several_recordings_give_one_gain(pendulum, swung):
    other = moved(pendulum, slower=2.0, file="other.csv")
    (found,) = estimated_gains((swung, other), pendulum)
    assert found.kp == pytest.approx(KP[0], rel=0.02)


def test_a_stated_gain_is_kept(planar):
    stated = Controller("pd", 61.0, 6.0)
    some = replace(planar, actuators=(Actuator(controller=stated), Actuator()))
    assert joints_without_stated_gains(some) == ("elbow",)
    robot, (recording,) = with_estimated_gains(some, (moved(planar),))
    assert robot.actuators[0].controller is stated
    assert robot.actuators[1].controller.kp == pytest.approx(KP[1], rel=0.02)
    assert recording.gains_estimated == ("elbow",)


def test_the_warning_says_what_was_estimated_and_what_it_rests_on(pendulum, swung):
    _, (recording,) = with_estimated_gains(pendulum, (swung,))
    (words,) = sentences(recording.notes)
    assert words.startswith("No gains of pin are stated: kp = 60")
    assert "as accurate as the gravity and the inertia of the model" in words
    assert "positions alone show kd/kp = 0.1" in words


def test_a_joint_that_needs_next_to_no_torque_tells_no_gain(pendulum):
    # Without weight and at a tenth of the speed inertia is a hundredth: friction is all that is felt.
    floating = with_gravity(pendulum, np.zeros(3))
    recording = moved(floating, slower=20.0)
    with pytest.raises(LogError, match=r"^moved\.csv: positions and references only, and neither gravity nor inertia "):
        with_estimated_gains(floating, (recording,))


@pytest.fixture(scope="module")
def rubbing(pendulum):
    """Diagnosis of a pendulum with 1 N m more Coulomb friction than modelled, its gains unknown."""
    recording = moved(pendulum, cause("coulomb_friction", "pin", 1.0))
    robot, recordings, motion = torque_or_motion(pendulum, read(recording), motion_only=True)
    assert motion
    return diagnose(*driven_by_controllers(robot, recordings))


@pytest.mark.whole
def test_friction_is_found_without_gains(rubbing):
    (finding,) = rubbing.findings
    assert finding.effect in ("coulomb_friction", "stribeck_friction", "presliding_friction")
    size = finding.parameters["coulomb_torque" if finding.effect == "stribeck_friction" else "torque"]
    assert size.value == pytest.approx(1.0, rel=0.15)


@pytest.mark.whole
@pytest.mark.parametrize("effect", ["torque_constant", "viscous_friction"])
def test_what_the_gains_take_up_cannot_be_tested(rubbing, effect):
    (entry,) = (entry for entry in rubbing.not_testable if entry.effect == effect)
    assert "gain" in entry.why
    assert not [bound for bound in rubbing.bounds if bound.effect == effect]


@pytest.mark.whole
def test_without_a_gap_and_without_gains_nothing_is_found(pendulum, swung):
    diagnosis = diagnose(*driven_by_controllers(pendulum, (swung,)))
    assert (diagnosis.verdict, diagnosis.findings) == ("no_gap", ())


@pytest.mark.whole
def test_viscous_friction_without_gains_is_no_finding(pendulum):
    diagnosis = diagnose(*driven_by_controllers(pendulum, (moved(pendulum, cause("viscous_friction", "pin", 2.0)),)))
    assert diagnosis.findings == ()


def test_what_is_true_of_all_recordings_is_reported_once(pendulum, swung):
    stated = replace(pendulum, actuators=(Actuator(controller=Controller("pd", 60.0, 6.0)),))
    other = replace(swung, file="other.csv")
    _, (first, second) = driven_by_controllers(stated, (swung, other))
    assert sentence(first.notes[-1]).startswith("moved.csv and 1 more: positions and references only: ")
    assert second.notes == other.notes


HELD_KP, KV = np.array([40.0, 25.0]), np.array([3.0, 2.0])

ARM = f"""<mujoco><compiler angle="radian"/>
  <worldbody><body name="upper"><joint name="lift" axis="0 1 0" damping="0.3"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1.2"/>
    <body name="lower" pos="0 0 -0.3"><joint name="slide" type="slide" axis="1 0 0" damping="0.5"/>
      <geom type="box" size="0.1 0.03 0.03" mass="0.8"/></body></body></worldbody>
  <actuator><position name="a" joint="lift" kp="{HELD_KP[0]}" kv="{KV[0]}"/>
    <position name="b" joint="slide" kp="{HELD_KP[1]}" kv="{KV[1]}"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def servo_arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    return load_robot(path)


def held(robot, rate: float) -> Recording:
    """20 s of servos at 2 kHz whose references stay between rows; the log has a row for each."""
    t, every = np.arange(40000) / 2000.0, round(2000.0 / rate)
    q_ref = np.stack([0.4 * np.sin(2.1 * t) + 0.2 * np.sin(5.3 * t + 1), 0.1 * np.sin(3.1 * t + 0.4)], axis=1)
    stairs = np.repeat(q_ref[::every], every, axis=0)[: len(t)]
    q = simulate(robot, (), position_control(t, stairs, 0 * stairs, kp=HELD_KP, kd=KV), t, stairs[0]).q[::every]
    return Recording("held.csv", robot.joint_names, t[::every], q, None, q_ref=stairs[::every])


def left(robot, recording: Recording) -> np.ndarray:
    """What the torque that the stated gains ask for leaves of the model, over the torque, root mean squares."""
    log = process(with_commanded_torque(recording, robot), commanded_robot(robot))
    inside = slice(len(log.motion.t) // 20, -len(log.motion.t) // 20)
    rest = (log.tau - inverse_dynamics(robot, log.motion))[inside]
    return np.sqrt((rest**2).mean(axis=0) / (log.tau[inside] ** 2).mean(axis=0))


@pytest.mark.parametrize("rate", [30.0, 50.0])
def test_the_gains_of_the_file_and_held_references_leave_nothing_of_an_arm(servo_arm, rate):
    # Closed form: taken as instant, references are half a row late.
    assert states_controllers(servo_arm)
    recording = held(servo_arm, rate)
    as_held = left(replace(servo_arm, reference_hold="zoh"), recording)
    instant = left(replace(servo_arm, reference_hold="instant"), recording)
    assert (as_held < 0.1).all()
    assert (as_held < 0.3 * instant).all()


def servo(kind: str, seed: int, folder: Path) -> tuple[Robot, Recording, DriveLoop]:
    """A servo with its controller, its log without the voltage, and the loop that the voltage shows."""
    urdf, config, log = case(kind, seed).write(folder)
    robot = load_robot(urdf, config=config)
    measured = read_recording(log, robot)
    (loop,) = measured.loops
    assert loop is not None
    drive = robot.actuators[0]
    controller = Controller(kp=loop.gain * per_volt(drive), kd=per_speed(drive))
    stated = commanded_robot(replace(robot, actuators=(replace(drive, controller=controller),)))
    return stated, replace(measured, tau=None, voltage=None, loops=(), torque_from={}, velocity_gain=None), loop


def notes_of(robot: Robot, recording: Recording) -> tuple[Note, ...]:
    return protection_notes(session_of(robot, (with_commanded_torque(recording, robot),)))


@pytest.mark.parametrize("seed", by_night([415, 418], 0))
def test_protection_shows_in_the_torque_that_the_model_needs(seed, tmp_path):
    robot, recording, loop = servo("protection", seed, tmp_path)
    (note,) = notes_of(robot, recording)
    assert note.joint == "j0"
    assert note.numbers["beyond"] == pytest.approx(loop.drops_beyond, rel=0.25)
    assert note.numbers["share"] == pytest.approx(loop.dropped, abs=0.06)
    assert "its drive may protect itself" in sentence(note)


@pytest.mark.parametrize("kind", ["null measured", "load measured", "friction measured"])
def test_a_servo_that_does_not_protect_itself_is_not_said_to(kind, tmp_path):
    for seed in (402, 413):
        if case(kind, seed).robot.count("<joint ") == 1:
            robot, recording, _ = servo(kind, seed, tmp_path)
            assert notes_of(robot, recording) == ()


def test_protection_that_is_stated_is_not_said_again(tmp_path):
    robot, recording, loop = servo("protection", 415, tmp_path)
    drive = robot.actuators[0]
    assert drive.controller is not None
    most = loop.drops_to * per_volt(drive)
    stated = replace(drive.controller, drops_beyond=loop.drops_beyond, drops_to=most)
    assert notes_of(replace(robot, actuators=(replace(drive, controller=stated),)), recording) == ()
