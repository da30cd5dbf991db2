"""Simulations of a robot against MuJoCo and closed forms."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.drive.torque_constant import TorqueConstant
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.transmission.backlash import Backlash
from phantom_dyn.effects.transmission.transmission_compliance import TransmissionCompliance
from phantom_dyn.errors import ParameterError
from phantom_dyn.simulation.control import Tracking, position_control, torque_over_time
from phantom_dyn.simulation.simulate import Cause, Given, simulate
from sample_sizes import CONTRACT_SIZES

REST = np.zeros(2)


def no_torque(t, q, v):
    return np.zeros(len(q))


def test_a_quarter_of_the_step_leaves_a_sixteenth_of_the_error(frictionless):
    # Second order: oracle is the same motion in steps that are shorter still.
    t, start = np.array([0.0, 0.4]), np.array([1.2, -0.5])
    end = [simulate(frictionless, (), no_torque, t, start, max_step=h).q[-1] for h in (8e-3, 2e-3, 5e-4)]
    assert np.linalg.norm(end[0] - end[2]) / np.linalg.norm(end[1] - end[2]) == pytest.approx(17.0, rel=0.15)


def test_uneven_samples_see_the_same_motion(planar, swinging, rng):
    controller, q0, v0 = swinging
    t = np.linspace(0.0, 0.4, 81)
    uneven = np.sort(rng.choice(t[1:-1], 30, replace=False))
    uneven = np.array([0.0, *uneven, 0.4])
    even = simulate(planar, (), controller, t, q0, v0).q
    at_same = even[np.searchsorted(t, uneven)]
    np.testing.assert_allclose(simulate(planar, (), controller, uneven, q0, v0).q, at_same, atol=1e-5)


def test_dry_friction_stops_a_wheel_when_its_impulse_is_used_up_and_then_holds_it(pendulum):
    # Closed form: v = v0 - T/I t until t = v0 I / T, with 0.7 N m on 0.6 kg m^2, and zero from there on.
    model = pendulum.model.copy()
    model.gravity = pin.Motion.Zero()
    wheel = replace(pendulum, model=model, viscous_friction=np.zeros(1))
    t = np.linspace(0.0, 1.2, 121)
    v = simulate(wheel, (), no_torque, t, np.zeros(1), np.ones(1), max_step=2e-3).links.v[:, 0]
    np.testing.assert_allclose(v, np.maximum(1.0 - 0.7 / 0.6 * t, 0.0), atol=1e-9)
    assert np.all(v[t > 0.6 / 0.7 + 2e-3] == 0.0)


def test_a_joint_that_friction_can_hold_never_moves(pendulum):
    # 2 kg x 9.81 x 0.5 m x sin(0.07) = 0.686 N m is less than 0.7 N m.
    s = simulate(pendulum, (), no_torque, np.linspace(0.0, 0.5, 26), np.array([0.07]))
    assert np.all(s.q == 0.07)


def test_a_joint_that_friction_cannot_hold_moves(pendulum):
    s = simulate(pendulum, (), no_torque, np.linspace(0.0, 0.5, 26), np.array([0.075]))
    assert s.q[-1, 0] < 0.075


def test_a_perfect_robot_needs_the_torque_of_its_model(planar, swinging):
    controller, q0, v0 = swinging
    s = simulate(planar, (), controller, np.linspace(0.0, 0.5, 101), q0, v0)
    error = np.abs(s.tau - inverse_dynamics(planar, s.links))[1:-1]
    assert np.median(error) < 1e-4 * np.abs(s.tau).max()


def test_a_held_torque_acts_until_the_next_sample(pendulum):
    # Closed form without gravity and friction: constant acceleration tau[k] / I from t[k] to t[k+1].
    model = pendulum.model.copy()
    model.gravity = pin.Motion.Zero()
    bare = replace(pendulum, model=model, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1), torque_hold="zoh")
    t = np.array([0.0, 0.1, 0.15, 0.3])
    s = simulate(bare, (), lambda t, q, v: np.array([1.0 + 10.0 * t]), t, np.zeros(1))
    np.testing.assert_allclose(s.tau[:, 0], 1.0 + 10.0 * t)
    np.testing.assert_allclose(np.diff(s.links.v[:, 0]), s.tau[:-1, 0] / 0.6 * np.diff(t), rtol=1e-9)


# Effects that are torques, drives or links, on the elbow or on the whole robot.
LAWS = (
    "viscous_friction",
    "coulomb_friction",
    "direction_dependent_friction",
    "stribeck_friction",
    "torque_offset",
    "torque_constant",
    "rotor_inertia",
    "payload",
    "parasitic_spring",
    "base_tilt",
)


@pytest.mark.parametrize("name", LAWS)
def test_the_recording_of_an_effect_shows_the_torque_of_its_law(planar, swinging, name):
    # What the drive needs beyond the model is minus the torque that the effect adds.
    controller, q0, v0 = swinging
    joint = None if effect_named(name).scope == "robot" else "elbow"
    theta = np.array(CONTRACT_SIZES[name])
    s = simulate(planar, (Cause(effect_named(name), joint, theta),), controller, np.linspace(0.0, 0.4, 81), q0, v0)
    law = effect_named(name).torque(planar, Operation.of(planar, s.links), joint, theta)
    # Not next to a reversal, where the means of acceleration and friction over a step differ from those of a sample.
    steady = np.abs(s.links.v).min(axis=1) > 0.3
    error = (s.tau - inverse_dynamics(planar, s.links) + law)[steady][1:-1]
    assert np.sqrt(np.mean(law**2)) > 0.05
    np.testing.assert_allclose(error, 0.0, atol=0.02)


def test_changed_links_need_the_torque_of_their_regressor(planar, swinging):
    controller, q0, v0 = swinging
    effect, theta = effect_named("inertial_parameters"), 0.1 * standard_parameters(planar)[10:]
    s = simulate(planar, (Cause(effect, "elbow", theta),), controller, np.linspace(0.0, 0.3, 61), q0, v0)
    law = effect.torque(planar, Operation.of(planar, s.links), "elbow", theta)
    error = (s.tau - inverse_dynamics(planar, s.links) + law)[np.abs(s.links.v).min(axis=1) > 0.3]
    np.testing.assert_allclose(error[1:-1], 0.0, atol=0.02)


def test_causes_act_together(planar, swinging):
    controller, q0, v0 = swinging
    both = (Cause(effect_named("torque_offset"), "elbow", np.array([0.4])),
            Cause(effect_named("torque_constant"), "elbow", np.array([0.5])))  # fmt: skip
    s = simulate(planar, both, controller, np.linspace(0.0, 0.2, 41), q0, v0)
    needed = inverse_dynamics(planar, s.links)[:, 1]
    steady = np.abs(s.links.v[:, 1]) > 0.3
    np.testing.assert_allclose((0.5 * s.tau[:, 1] + 0.4 - needed)[steady][1:-1], 0.0, atol=0.02)


def test_a_torque_sensor_logs_what_the_drive_gave(planar, swinging):
    controller, q0, v0 = swinging
    sensed = replace(planar, torque_source="sensor", torque_hold="zoh")
    cause = Cause(TorqueConstant(), "elbow", np.array([0.5]))
    t = np.linspace(0.0, 0.05, 11)
    s = simulate(sensed, (cause,), controller, t, q0, v0)
    asked = simulate(replace(sensed, torque_source="command"), (cause,), controller, t, q0, v0).tau
    np.testing.assert_allclose(s.tau[1:, 1], 0.5 * asked[:-1, 1])


def test_a_motor_without_inertia_cannot_move_by_itself(planar):
    model = planar.model.copy()
    model.armature = np.array([0.3, 0.0])
    with pytest.raises(ParameterError, match=r"Joint elbow has no rotor inertia: .* give joints\.elbow\.rotor_inertia"):
        simulate(
            replace(planar, model=model),
            (Cause(Backlash(), "elbow", np.array([0.01])),),
            no_torque,
            np.arange(3.0),
            REST,
        )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"t": np.array([0.0])}, "The times of a simulation do not increase"),
        ({"t": np.array([0.0, 0.1, 0.1])}, "The times of a simulation do not increase"),
        ({"q0": np.zeros(3)}, r"q0 has shape \(3,\), wanted 2 numbers, one a joint\."),
        ({"q0": np.array([0.0, np.nan])}, r"q0 is .*: give finite numbers"),
        ({"q0": np.array([0.0, np.inf])}, r"q0 is .*: give finite numbers"),
        ({"given": Given((REST, np.zeros(3)))}, r"motors\[1\] has shape \(3,\), wanted 2 numbers, one a joint\."),
        ({"max_step": 0.0}, r"max_step is .* s: give a length above zero"),
        ({"max_step": -1e-3}, r"max_step is .* s: give a length above zero"),
        ({"max_step": np.nan}, r"max_step is .* s: give a length above zero"),
        (
            {"controller": torque_over_time(np.arange(2.0), np.zeros((2, 3)))},
            r"The tracking law is one of 3 joints and the robot has 2: give as many",
        ),
        ({"controller": lambda t, q, v: np.zeros(1)}, r"The controller gave a torque of shape \(1,\), wanted 2 numb"),
    ],
)
def test_arguments_that_cannot_be_are_refused(planar, given, message):
    usual = {"causes": (), "controller": no_torque, "t": np.arange(3.0), "q0": REST}
    with pytest.raises(ParameterError, match=message):
        simulate(planar, **(usual | given))


def two_masses(tendon: str) -> mujoco.MjModel:
    """A rotor of 0.1 and a wheel of 0.2 kg m^2 on one axis, and what is between them."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler inertiafromgeom="false"/>
    <option timestep="2e-5" gravity="0 0 0" integrator="Euler"/><worldbody>
    <body><joint name="m" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body>
    <body><joint name="l" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="0.2 0.2 0.2"/></body>
    </worldbody><tendon><fixed {tendon}><joint joint="m" coef="1"/><joint joint="l" coef="-1"/></fixed></tendon>
    </mujoco>""")


@pytest.fixture
def wheel(pendulum):
    """A rotor of 0.1 kg m^2 on a rod of which 0.2 kg m^2 turn, without gravity and friction."""
    model = pendulum.model.copy()
    model.inertias[1] = pin.Inertia(1.0, np.zeros(3), np.diag([0.2, 0.2, 0.2]))
    model.armature = np.array([0.1])
    model.gravity = pin.Motion.Zero()
    return replace(pendulum, model=model, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))


def pushed(model: mujoco.MjModel, t: np.ndarray, torque) -> np.ndarray:
    """Angles of motor and link at ``t`` while the motor is pushed."""
    data, out = mujoco.MjData(model), []
    for when in t:
        while data.time < when - 1e-9:
            data.qfrc_applied[0] = torque(data.time)
            mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    return np.array(out)


def test_a_spring_between_motor_and_link_moves_as_in_mujoco(wheel):
    t, push = np.linspace(0.0, 0.4, 41), lambda time: 2.0 * np.sin(15.0 * time)
    spring = TransmissionCompliance().simulated(wheel, "pin", np.array([80.0])).transmission
    assert spring is not None
    expected = pushed(two_masses(f'stiffness="80" damping="{spring.damping}" springlength="0 0"'), t, push)
    cause = Cause(TransmissionCompliance(), "pin", np.array([80.0]))
    s = simulate(wheel, (cause,), lambda time, q, v: np.array([push(time)]), t, np.zeros(1))
    np.testing.assert_allclose(np.column_stack([s.encoders.q, s.links.q]), expected, atol=2e-5)


def test_a_play_between_motor_and_link_moves_as_in_mujoco(wheel):
    # A stop is a spring of its own there and here: what is compared is the motion, not the contact.
    t, push = np.linspace(0.0, 0.6, 61), lambda time: 2.0 * np.sin(12.0 * time)
    expected = pushed(two_masses('limited="true" range="-0.02 0.02" solreflimit="0.004 1"'), t, push)
    cause = Cause(Backlash(), "pin", np.array([0.04]))
    s = simulate(wheel, (cause,), lambda time, q, v: np.array([push(time)]), t, np.zeros(1))
    moved = np.column_stack([s.encoders.q, s.links.q])
    assert np.abs(moved - expected).max() < 0.02 * np.abs(expected).max()
    assert np.ptp(moved[:, 0] - moved[:, 1]) == pytest.approx(0.04, rel=0.05)


@pytest.mark.parametrize(("side", "seen"), [("motor", "encoders"), ("link", "links")])
def test_an_encoder_reads_the_side_on_which_it_sits(wheel, side, seen):
    robot = replace(wheel, actuators=tuple(replace(one, encoder_side=side) for one in wheel.actuators))
    cause = Cause(TransmissionCompliance(), "pin", np.array([80.0]))
    s = simulate(robot, (cause,), lambda t, q, v: np.ones(1), np.linspace(0.0, 0.1, 11), np.zeros(1))
    np.testing.assert_array_equal(s.q, getattr(s, seen).q)
    assert (np.abs(s.q - s.links.q).max() > 1e-3) == (side == "motor")


def test_a_motor_that_starts_apart_swings_against_its_link(wheel):
    # Closed form: apart = a exp(-d w t) cos(w t sqrt(1 - d^2)), with w^2 = k (1/0.1 + 1/0.2), from a start that fits.
    k, damped, t = 80.0, 0.05, np.linspace(0.0, 0.3, 61)
    w = np.sqrt(k * 15.0)
    cause = Cause(TransmissionCompliance(), "pin", np.array([k]))
    motors = np.array([0.02]), np.array([-0.02 * damped * w])
    s = simulate(wheel, (cause,), no_torque, t, np.zeros(1), given=Given(motors))
    apart = (s.encoders.q - s.links.q)[:, 0]
    expected = 0.02 * np.exp(-damped * w * t) * np.cos(w * np.sqrt(1.0 - damped**2) * t)
    np.testing.assert_allclose(apart, expected, atol=2e-4)


def test_motors_of_rigid_joints_do_not_count(planar, swinging):
    controller, q0, v0 = swinging
    t = np.linspace(0.0, 0.1, 11)
    elsewhere = np.full(2, 9.0), np.full(2, -9.0)
    moved = simulate(planar, (), controller, t, q0, v0, given=Given(elsewhere))
    np.testing.assert_array_equal(moved.q, simulate(planar, (), controller, t, q0, v0).q)


T = np.array([0.0, 1.0, 3.0])


def test_torques_are_linear_between_their_times_and_held_beyond_them():
    law = torque_over_time(T, np.array([[0.0, 5.0], [2.0, 5.0], [6.0, 7.0]]))
    expected = {-1.0: [0, 5], 0.5: [1, 5], 1.0: [2, 5], 2.0: [4, 6], 9.0: [6, 7]}
    for t, torque in expected.items():
        np.testing.assert_allclose(law(t, np.ones(2), np.ones(2)), torque)


def test_position_control_asks_for_gains_times_errors():
    law = position_control(T, np.ones((3, 1)), np.full((3, 1), 2.0), kp=np.array([10.0]), kd=np.array([3.0]))
    np.testing.assert_allclose(law(0.3, np.array([0.6]), np.array([1.0])), 10.0 * 0.4 + 3.0 * 1.0)


def test_the_limit_holds_all_but_what_is_added_behind_it():
    law = torque_over_time(T, np.full((3, 1), 5.0))
    law = replace(law, limits=np.array([2.0]), extra=np.full((3, 1), 0.5))
    np.testing.assert_allclose(law(0.0, np.zeros(1), np.zeros(1)), 2.5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: Tracking(T, *(np.zeros((n, 1)) for n in (3, 2, 3, 3, 3, 3)), limits=np.ones(1)),
            r"q_ref of a tracking law has shape \(2, 1\), wanted \(3, 1\)",
        ),
        (lambda: torque_over_time(np.zeros(1), np.zeros((1, 1))), "The times of a tracking law do not increase"),
        (lambda: torque_over_time(np.array([0.0, 0.0, 1.0]), np.zeros((3, 1))), "times of a tracking law do not"),
        (lambda: torque_over_time(np.array([0.0, np.nan, 1.0]), np.zeros((3, 1))), "times of a tracking law do not"),
        (
            lambda: torque_over_time(T, np.array([[0.0], [np.nan], [1.0]])),
            "feedforward of a tracking law is not finite everywhere",
        ),
        (
            lambda: torque_over_time(T, np.zeros(3)),
            r"The torque has shape \(3,\), wanted a row a time and a column a joint",
        ),
        (
            lambda: replace(torque_over_time(T, np.zeros((3, 1))), limits=np.array([-1.0])),
            "A limit of a tracking law is negative",
        ),
    ],
)
def test_tables_that_cannot_be_are_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


def test_gains_may_change_with_time():
    zero = np.zeros((3, 1))
    law = Tracking(T, zero, zero, zero, np.array([[0.0], [4.0], [4.0]]), zero, zero, np.array([np.inf]))
    np.testing.assert_allclose(law(0.5, np.array([-1.0]), np.zeros(1)), 2.0)
