"""Recordings without torque, moved by a simulated controller whose truth is known."""

from dataclasses import fields, replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.diagnosis.columns.motion.standstill import usable_samples
from identification.diagnosis.result import EffectAt, Judgement, Value
from identification.engine.claims import Claim
from identification.pipeline import diagnose
from identification.rollout.compare import Rollout
from identification.scenarios.gain_ambiguities import without_gain_ambiguities
from identification.scenarios.gains import estimated_gains
from identification.scenarios.motion_only import commanded_robot, limited_controller_torque, with_commanded_torque
from identification.words.note_words import sentences
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Actuator, Controller, Robot
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, Simulation, simulate
from places import ROBOTS

# Whole diagnoses: what they call is checked beside the functions.
pytestmark = pytest.mark.whole

KP, KD = 60.0, 6.0


@pytest.fixture(scope="module")
def pendulum() -> Robot:
    """A rod on joint pin whose controller is stated."""
    robot = load_robot(ROBOTS / "pendulum.urdf")
    return replace(robot, actuators=(Actuator(controller=Controller(kp=KP, kd=KD)),))


def moved(robot: Robot, *causes: Cause, noise: float = 1e-5) -> tuple[Recording, Simulation]:
    """12 s at 250 Hz of references and positions, and the simulation behind them."""
    rng = np.random.default_rng(3)
    t = np.arange(3000) / 250.0
    sines = [0.3 / hz**0.5 * np.sin(2 * np.pi * hz * t + phase) for hz, phase in ((0.21, 0.3), (0.53, 1.2), (1.1, 2.5))]
    q_ref = np.sum(sines, axis=0)[:, None]
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=np.array([KP]), kd=np.array([KD]))
    found = simulate(robot, causes, law, t, np.zeros(1))
    q = found.q + noise * rng.standard_normal(q_ref.shape)
    return Recording("moved.csv", robot.joint_names, t, q, None, q_ref=q_ref), found


@pytest.fixture(scope="module")
def recording(pendulum) -> Recording:
    """Of the pendulum as it is modelled."""
    return moved(pendulum)[0]


def cause(effect: str, joint: str | None, *theta: float) -> Cause:
    return Cause(effect_named(effect), joint, np.array(theta))


@pytest.fixture(scope="module")
def rubbing(pendulum):
    """Diagnosis of a pendulum with 1 N m more Coulomb friction than modelled, from positions alone."""
    recording, _ = moved(pendulum, cause("coulomb_friction", "pin", 1.0))
    return diagnose(commanded_robot(pendulum), (with_commanded_torque(recording, pendulum),))


def test_the_torque_is_the_one_that_the_simulated_controller_asked_for(pendulum):
    recording, found = moved(pendulum, noise=1e-7)
    rebuilt = limited_controller_torque(recording, pendulum)
    assert np.abs(rebuilt - found.tau)[20:-20].max() < 0.1


def test_a_late_controller_asks_later(pendulum, recording):
    late = replace(pendulum, actuators=(Actuator(controller=Controller(kp=KP, kd=KD, delay=0.008)),))
    ours, plain = limited_controller_torque(recording, late), limited_controller_torque(recording, pendulum)
    np.testing.assert_allclose(ours[2:], plain[:-2], atol=1e-9)


def test_a_controller_asks_no_more_than_its_drive_gives(pendulum, recording):
    weak = replace(pendulum, actuators=(replace(pendulum.actuators[0], torque_limit=2.0),))
    assert np.abs(limited_controller_torque(recording, weak)).max() == 2.0


def test_a_controller_whose_reference_is_late_follows_the_earlier_one(pendulum, recording):
    # Five samples of 4 ms: position and speed are as they are, the reference is that of 20 ms before.
    late = replace(pendulum, actuators=(Actuator(controller=Controller(kp=KP, kd=KD, reference_delay=0.02)),))
    ours, plain = limited_controller_torque(recording, late), limited_controller_torque(recording, pendulum)
    q_ref = recording.q_ref
    np.testing.assert_allclose((ours - plain)[5:], KP * (q_ref[:-5] - q_ref[5:]), atol=1e-9)


def test_a_torque_that_drops_where_the_error_is_large_is_asked_for_as_it_is(pendulum, recording):
    # Closed form on every sample: no more than 0.5 N m of stiffness where the error is above 0.02 rad.
    protected = Controller("duty", kp=KP, kd=0.0, drops_beyond=0.02, drops_to=0.5)
    ours = limited_controller_torque(recording, replace(pendulum, actuators=(Actuator(controller=protected),)))
    error = recording.q_ref - recording.q
    large = np.abs(error) > 0.02
    assert large.any()
    np.testing.assert_allclose(ours, np.where(large, np.clip(KP * error, -0.5, 0.5), KP * error))


def test_a_servo_puts_a_share_of_the_measured_supply_on_its_motor(pendulum, recording):
    # Closed form: a supply of 9 V where 12 V are stated takes a quarter of what follows the reference.
    drive = Actuator(torque_constant=1.0, resistance=2.0, voltage_limit=12.0, controller=Controller("duty", kp=KP))
    robot = replace(pendulum, actuators=(drive,))
    sagging = replace(recording, supply=np.linspace(12.0, 9.0, len(recording.t)))
    plain, ours = limited_controller_torque(recording, robot), limited_controller_torque(sagging, robot)
    np.testing.assert_allclose(ours[:, 0], plain[:, 0] * np.linspace(1.0, 0.75, len(ours)), atol=1e-12)


def test_a_supply_does_not_change_gains_that_are_stated_as_torques(pendulum, recording):
    sagging = replace(recording, supply=np.full(len(recording.t), 9.0))
    np.testing.assert_array_equal(
        limited_controller_torque(sagging, pendulum), limited_controller_torque(recording, pendulum)
    )


def test_friction_is_named_from_positions_alone(rubbing):
    (finding,) = rubbing.findings
    assert finding.joint == "pin"
    assert finding.effect in ("coulomb_friction", "stribeck_friction", "presliding_friction")
    size = finding.parameters["coulomb_torque" if finding.effect == "stribeck_friction" else "torque"]
    assert size.value == pytest.approx(1.0, rel=0.15)


def test_the_closed_loop_is_judged_in_motion(rubbing):
    assert rubbing.rollout["rms_after"]["pin"] < 0.3 * rubbing.rollout["rms_before"]["pin"]


def test_the_torque_constant_is_not_testable_and_the_reason_is_the_gain(rubbing):
    (entry,) = (entry for entry in rubbing.not_testable if entry.effect == "torque_constant")
    assert "product of torque constant and controller gain" in entry.why
    assert not [bound for bound in rubbing.bounds if bound.effect == "torque_constant"]


def judgement_of(diagnosis):
    """The part of a diagnosis that fits alone decide."""
    shared = {
        field.name: getattr(diagnosis, field.name) for field in fields(Judgement) if hasattr(diagnosis, field.name)
    }
    return Judgement(**shared)


def test_where_a_torque_was_measured_nothing_is_taken_back(rubbing, pendulum, recording):
    judgement = judgement_of(rubbing)
    assert without_gain_ambiguities(judgement, (recording,), Rollout(None, {}, {}), pendulum) is judgement


def test_without_a_gain_the_refusal_says_what_is_needed(pendulum, recording):
    silent = replace(pendulum, actuators=(Actuator(),))
    with pytest.raises(LogError, match="states no controller with a gain kp of pin: --motion-only needs it"):
        with_commanded_torque(recording, silent)


def test_the_gains_that_moved_the_true_model_are_suggested(pendulum):
    # 1 N m of dry friction that the model lacks is not taken for a gain.
    recording, _ = moved(pendulum, cause("coulomb_friction", "pin", 1.0))
    (found,) = estimated_gains((recording,), replace(pendulum, actuators=(Actuator(),)))
    assert found.kp == pytest.approx(KP, rel=0.02)
    assert found.kd == pytest.approx(KD, rel=0.05)


def test_gains_of_a_recording_of_a_few_rows_are_not_suggested(pendulum, recording):
    short = replace(recording, t=recording.t[:9], q=recording.q[:9], q_ref=recording.q_ref[:9])
    with pytest.raises(LogError, match=r"moved\.csv is too short, or a reference is no number"):
        estimated_gains((short,), pendulum)


def test_a_reference_that_never_leaves_the_joint_tells_no_gain(pendulum, recording):
    (found,) = estimated_gains((replace(recording, q=recording.q_ref),), pendulum)
    assert np.isnan([found.kp, found.kd]).all()


def test_without_references_the_refusal_says_what_is_needed(pendulum, recording):
    with pytest.raises(LogError, match=r"has no q_ref.<joint> of every joint: --motion-only needs the references"):
        with_commanded_torque(replace(recording, q_ref=None), pendulum)


def test_a_reference_that_is_no_number_is_refused(pendulum, recording):
    q_ref = np.array(recording.q_ref)
    q_ref[7] = np.nan
    with pytest.raises(LogError, match=r"q_ref.pin is nan in row 7"):
        with_commanded_torque(replace(recording, q_ref=q_ref), pendulum)


def test_too_few_rows_are_refused(pendulum, recording):
    short = replace(recording, t=recording.t[:5], q=recording.q[:5], q_ref=recording.q_ref[:5])
    with pytest.raises(LogError, match="has 5 rows"):
        with_commanded_torque(short, pendulum)


@pytest.mark.parametrize(("ratio", "outcome"), [(1.19, "not_claimed"), (1.21, "claimed")])
def test_a_torque_constant_within_twice_the_tolerance_of_the_gain_is_not_claimed(
    rubbing, recording, pendulum, ratio, outcome
):
    # By hand: a stated gain is trusted to a tenth.
    asked = (with_commanded_torque(recording, pendulum),)
    size = {"ratio": Value(ratio, 0.01, "1")}
    finding = replace(rubbing.findings[0], effect="torque_constant", joint="pin", parameters=size)
    claim = Claim((EffectAt("torque_constant", "pin"),), (), "claimed")
    given = replace(judgement_of(rubbing), findings=(finding,), ledger=(claim,))
    found = without_gain_ambiguities(given, asked, Rollout(None, {}, {}), pendulum)
    (entry,) = found.ledger
    assert entry.outcome == outcome
    assert (outcome == "claimed") is (finding in found.findings)
    (result,) = entry.gates
    assert (result.gate, result.value, result.needed) == ("beyond the gain", pytest.approx(ratio - 1.0), 0.2)


def test_a_torque_offset_is_stated_with_the_zero_of_the_reference_that_makes_it(rubbing, recording, pendulum):
    # Closed form: a reference that is a quarter of a radian too large asks for a quarter of the gain more.
    asked = (with_commanded_torque(replace(recording, q_ref=recording.q_ref + 0.25), pendulum),)
    size = {"torque": Value(-0.25 * KP, 0.01, "N m")}
    finding = replace(rubbing.findings[0], effect="torque_offset", joint="pin", parameters=size)
    given = replace(judgement_of(rubbing), findings=(finding,), ledger=(), warnings=())
    found = without_gain_ambiguities(given, asked, Rollout(None, {}, {}), pendulum)
    assert found.findings == (finding,)
    (warning,) = sentences(found.warnings)
    assert "q_ref.pin: {from: q_ref.pin, offset: -0.25} in a column map has the same effect" in warning


def test_without_a_gap_in_torque_motion_that_strays_is_noted(rubbing, recording, pendulum):
    asked = (with_commanded_torque(recording, pendulum),)
    rollout = Rollout(0.5, {"pin": 0.02}, {"pin": 0.01}, noise={"pin": 1e-4})
    still = replace(judgement_of(rubbing), findings=(), verdict="no_gap", notes=())
    (note,) = sentences(without_gain_ambiguities(still, asked, rollout, pendulum).notes)
    assert "under its controller pin strays by 0.01 rad from the recorded motion, 100 times the noise of its" in note
    near = replace(rollout, rms_after={"pin": 5e-4})
    assert without_gain_ambiguities(still, asked, near, pendulum).notes == ()
    # Closed form: a torque that is no gap gives the controller way by that torque over its gain.
    (gap,) = still.joints
    soft = replace(still, joints=(replace(gap, noise_floor_interval=(0.0, 0.011 * KP), discrepancy=None),))
    assert without_gain_ambiguities(soft, asked, rollout, pendulum).notes == ()


def test_what_controllers_ask_for_keeps_its_band(pendulum):
    # Under a soft controller the torque has nothing above 2 Hz, which is no recorder's smoothing: the motion says 4 Hz.
    recording, _ = moved(pendulum, cause("coulomb_friction", "pin", 1.0))
    asked = with_commanded_torque(recording, pendulum)
    wide = process_all((asked,), commanded_robot(pendulum))[1]
    assert wide >= process_all((replace(asked, controlled=False),), commanded_robot(pendulum))[1]
    (log,), _ = process_all((asked,), commanded_robot(pendulum))
    assert usable_samples(log).mean() > 0.8


@pytest.fixture(scope="module")
def late(pendulum):
    """Diagnosis of a pendulum whose references arrive 25 ms late, from positions alone."""
    recording, _ = moved(pendulum, cause("reference_delay", "pin", 0.025))
    return diagnose(commanded_robot(pendulum), (with_commanded_torque(recording, pendulum),))


def test_a_late_reference_is_named_with_its_delay(late):
    first = late.findings[0]
    assert [finding.effect for finding in late.findings] == ["reference_delay"]
    assert first.parameters["delay"].value == pytest.approx(0.025, abs=0.001)


def test_a_late_reference_is_simulated_in_the_closed_loop(late):
    assert late.rollout["rms_after"]["pin"] < 0.2 * late.rollout["rms_before"]["pin"]


def test_references_in_time_are_not_late(pendulum, recording):
    found = diagnose(commanded_robot(pendulum), (with_commanded_torque(recording, pendulum),))
    assert found.findings == ()


def held(robot: Robot, rate: float = 40.0) -> Recording:
    """24 s of a servo at 2 kHz whose references arrive at ``rate`` and are held; its log has a row for each."""
    t = np.arange(48000) / 2000.0
    q_ref = 0.5 * np.sin(2 * np.pi * 0.2 * t + 0.3) + 0.3 * np.sin(2 * np.pi * 0.6 * t)
    every = round(2000.0 / rate)
    stairs = np.repeat(q_ref[::every], every)[: len(t), None]
    law = position_control(t, stairs, np.zeros_like(stairs), kp=np.array([KP]), kd=np.array([KD]))
    q = simulate(robot, (), law, t, stairs[0]).q[::every]
    noise = 1e-5 * np.random.default_rng(4).standard_normal(q.shape)
    return Recording("held.csv", robot.joint_names, t[::every], q + noise, None, q_ref=stairs[::every])


def test_a_held_reference_is_no_gap_where_it_is_said(pendulum):
    robot = replace(pendulum, reference_hold="zoh")
    found = diagnose(commanded_robot(robot), (with_commanded_torque(held(robot), robot),))
    assert found.findings == ()


def test_a_held_reference_is_half_a_frame_late_where_nobody_says_so(pendulum):
    # Closed form: a step that lasts for 25 ms is on average 12.5 ms late.
    found = diagnose(commanded_robot(pendulum), (with_commanded_torque(held(pendulum), pendulum),))
    assert [finding.effect for finding in found.findings] == ["reference_delay"]
    assert found.findings[0].parameters["delay"].value == pytest.approx(0.0125, abs=0.002)


def test_a_format_that_holds_references_needs_no_key(pendulum):
    recording = replace(held(pendulum), references_held=True)
    assert diagnose(commanded_robot(pendulum), (with_commanded_torque(recording, pendulum),)).findings == ()


def test_the_largest_voltage_bounds_what_follows_the_reference(pendulum, recording):
    # By hand: 0.5 N m/V times 3 V; the damping comes on top of it.
    drive = replace(pendulum.actuators[0], torque_constant=1.0, resistance=2.0, voltage_limit=3.0)
    weak = replace(pendulum, actuators=(drive,))
    v = np.gradient(recording.q, recording.t, axis=0)
    wanted = np.clip(KP * (recording.q_ref - recording.q), -1.5, 1.5) - KD * v
    np.testing.assert_allclose(limited_controller_torque(recording, weak), wanted, atol=1e-12)
