"""Logs as a cheaper device would have given them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from identification.data.reading import recording
from identification.data.recording import Table
from identification.degrade.degraded_log import Degraded, degradation, degrade
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.simulate import Cause
from places import ROBOTS
from sample_sizes import sample_size


@pytest.mark.parametrize(
    ("effect", "joint", "values", "theta"),
    [
        ("coulomb_friction", "tilt", {"torque": (0.3,)}, (0.3,)),
        ("cogging", "tilt", {"amplitude": (0.1, 0.2), "order": (6, 12), "phase": (0, 1)}, (6, 12, 0.1, 0.2, 0, 1)),
        ("encoder_eccentricity", "tilt", {"amplitude": (0.01,), "phase": (0.5,)}, (0.01, 0.5, 1.0)),
        ("presliding_friction", "tilt", {"torque": (0.5,), "displacement": (0.01,)}, (0.5, 0.01, 0.0)),
        (
            "presliding_friction",
            "tilt",
            {"torque": (0.5,), "displacement": (0.01,), "static_ratio": (1.05,), "stick_velocity": (0.1,)},
            (0.5, 0.01, 0.0, 1.05, 0.1),
        ),
        ("inertial_parameters", "slide", {"slide.m": (0.2,)}, (0.2, *(0.0,) * 9)),
        ("input_delay", None, {"delay": (0.004,)}, (0.004,)),
        ("payload", None, {"mass": (1,), "center_x": (0,), "center_y": (0,), "center_z": (0.1,)}, (1, 0, 0, 0.1)),
    ],
)
def test_parameters_come_in_the_contracts_order(arm, effect, joint, values, theta):
    # Contract: the table of effects; one cycle per turn of an eccentric disc, and what is not named did not move.
    made = degradation(arm, effect, joint, values)
    assert (made.effect.name, made.joint, tuple(made.theta)) == (effect, joint, theta)


@pytest.mark.parametrize(
    ("effect", "joint", "values", "words"),
    [
        ("friction", "tilt", {}, "Unknown effect 'friction': the effects are viscous_friction, coulomb_friction"),
        ("coulomb_friction", "wrist", {}, "coulomb_friction needs a place and 'wrist' was given: give one of turn, ti"),
        ("coulomb_friction", None, {}, "coulomb_friction needs a place and no joint was given: give one of turn"),
        (
            "joint_coupling",
            "tilt+tilt",
            {},
            "joint_coupling needs a place and 'tilt.tilt' was given: give",
        ),
        ("payload", "tilt", {}, "payload is of the whole robot, not of joint 'tilt': leave the joint out"),
        (
            "coulomb_friction",
            "slide",
            {"force": (1.0,)},
            r"has no parameter 'force': the parameters of coulomb_friction are torque \[N\] of -3 or more",
        ),
        (
            "backlash",
            "tilt",
            {},
            r"backlash lacks its parameter gap: the parameters of backlash are gap \[rad\] of 0 or more",
        ),
        (
            "backlash",
            "tilt",
            {"gap": (-0.1,)},
            r"gap=-0.1 of backlash is out of bounds: wanted gap \[rad\] of 0",
        ),
        ("base_tilt", None, {"roll": (2.0,), "pitch": (0.0,)}, r"wanted roll \[rad\] from -1.571 to 1.571"),
        ("backlash", "tilt", {"gap": (0.1, 0.2)}, "gap of backlash was given 2 numbers: it takes one"),
        (
            "cogging",
            "tilt",
            {"order": (6, 12), "amplitude": (0.1,), "phase": (0.0,)},
            "cogging was given 2 of order, 1 of amplitude, 1 of phase: give as many numbers of each",
        ),
        ("encoder_quantization", "tilt", {"step": (0.0,)}, "step=0 of encoder_quantization .* wanted a number above 0"),
        ("transmission_compliance", "tilt", {"stiffness": (0.0,)}, "stiffness=0 of transmission_compliance is out"),
        (
            "presliding_friction",
            "tilt",
            {"torque": (0.5,), "displacement": (0.01,), "static_ratio": (1.05,)},
            "presliding_friction lacks its parameter stick_velocity",
        ),
    ],
)
def test_a_refusal_says_what_there_is(arm, effect, joint, values, words):
    with pytest.raises(ParameterError, match=words):
        degradation(arm, effect, joint, values)


RATE = 500.0

# One size of every effect on the elbow, or the whole robot.
# Of other effects see `sample_size`.
SIZES = {
    "viscous_friction": {"coefficient": 0.4},
    "coulomb_friction": {"torque": 0.3},
    "direction_dependent_friction": {
        "torque_positive": 0.5,
        "torque_negative": 0.3,
        "coefficient_positive": 0.05,
        "coefficient_negative": 0.3,
    },
    "stribeck_friction": {"coulomb_torque": 0.3, "static_torque": 0.9, "stribeck_velocity": 0.25},
    "torque_offset": {"torque": 0.3},
    "torque_constant": {"ratio": 0.8},
    "rotor_inertia": {"inertia": 0.1},
    "payload": {"mass": 0.5, "center_x": 0.0, "center_y": 0.0, "center_z": -0.3},
    "inertial_parameters": {"elbow.m": 0.3},
    "parasitic_spring": {"stiffness": 3.0, "rest_position": 0.2},
    "presliding_friction": {"torque": 0.3, "displacement": 0.02},
    "load_dependent_friction": {"ratio": 0.1},
    "position_dependent_friction": {"position": 0.0, "torque": 0.3},
    "temperature_dependent_friction": {"coulomb_torque": 0.3, "coefficient": 0.1, "torque_slope": -0.01},
    "joint_coupling": {"ratio": 1.0, "coulomb_torque": 0.3, "coefficient": 0.1, "inertia": 0.01},
    "cogging": {"order": 12.0, "amplitude": 0.2, "phase": 0.3},
    "torque_ripple": {"order": 12.0, "amplitude": 0.05, "phase": 0.3},
    "torque_saturation": {"limit": 2.0},
    "input_delay": {"delay": 0.006},
    "actuator_lag": {"time_constant": 0.006},
    "backlash": {"gap": 0.002},
    "transmission_compliance": {"stiffness": 400.0},
    "base_tilt": {"roll": 0.0, "pitch": 0.1},
    "encoder_offset": {"offset": 0.05},
    "encoder_eccentricity": {"amplitude": 0.02, "phase": 0.4},
    "encoder_quantization": {"step": 0.01},
}

READINGS = ("encoder_offset", "encoder_eccentricity", "encoder_quantization")


@pytest.fixture(scope="module")
def degraded_arm() -> Robot:
    """Two links on shoulder and elbow, with modelled friction and rotors of their own."""
    robot = load_robot(ROBOTS / "planar2.urdf")
    model = robot.model.copy()
    model.armature = np.array([0.05, 0.02])
    return replace(robot, model=model)


def swinging(seconds: float = 6.0, ahead: float = 0.0) -> Motion:
    """Two joints in sines of several frequencies, that of ``ahead`` seconds later."""
    t = np.arange(round(seconds * RATE)) / RATE
    w, phase = np.array([[2.0, 5.1], [2.6, 6.3]]), np.array([[0.1, 1.0], [2.0, 0.3]])
    angle = w * (t + ahead)[:, None, None] + phase
    size = np.array([[0.7, 0.15], [0.6, 0.15]])
    q, v, a = ((size * wave).sum(axis=2) for wave in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    return Motion(t, q, v, a)


def table_of(robot: Robot, motion: Motion, tau: np.ndarray, **more: np.ndarray) -> Table:
    columns = {"t": motion.t}
    for name, values in (("q", motion.q), ("tau", tau), *more.items()):
        columns |= {f"{name}.{joint}": values[:, k] for k, joint in enumerate(robot.joint_names)}
    return Table("swing.csv", columns)


Degrader = Callable[..., Degraded]


@pytest.fixture(scope="module")
def clean(degraded_arm) -> tuple[Motion, Table]:
    """A recording without a gap and without noise."""
    motion = swinging()
    return motion, table_of(degraded_arm, motion, inverse_dynamics(degraded_arm, motion), v=motion.v)


def fault(robot: Robot, effect: str, joint: str | None = "elbow", **values: float) -> Cause:
    if effect in ("payload", "base_tilt"):
        joint = None
    if effect == "joint_coupling":
        joint = "shoulder+elbow"
    given = values or SIZES.get(effect) or sample_size(effect_named(effect), robot, joint)
    return degradation(robot, effect, joint, {name: (value,) for name, value in given.items()})


def degraded(robot: Robot, table: Table, *faults: Cause) -> Degraded:
    return degrade(robot, table, recording(table, robot), faults)


# What is late is the reference of a controller: a recording without references has none.
APART = (*READINGS, "torque_saturation", "reference_delay")

IN_TORQUE = [effect.name for effect in EFFECTS if effect.name not in APART]


@pytest.mark.parametrize("effect", IN_TORQUE)
def test_the_motion_is_kept_and_the_drive_makes_up_for_the_effect(degraded_arm, clean, effect):
    # Known truth: the law along the motion in closed form; ends and steps are where the recording was smoothed.
    motion, table = clean
    out = degraded(degraded_arm, table, made := fault(degraded_arm, effect)).columns
    assert list(out) == list(table.columns)
    for joint in degraded_arm.joint_names:
        np.testing.assert_array_equal(out[f"q.{joint}"], table.columns[f"q.{joint}"])
    law = made.effect.torque(degraded_arm, Operation.of(degraded_arm, motion), made.joint, made.theta)
    changed = np.column_stack([out[f"tau.{j}"] - table.columns[f"tau.{j}"] for j in degraded_arm.joint_names])
    error = np.abs(changed + law)[250:-250]
    assert np.abs(changed).max() > 0.01
    assert np.quantile(error, 0.8) < 0.02 * np.abs(law).max()


def test_friction_follows_the_temperature_of_the_recording(degraded_arm, clean):
    # Closed form: (T + kT d) s + (c + kc d) v more, d from the reference of 25 degrees on; samples of a reversal aside.
    motion, table = clean
    warm = table_of(
        degraded_arm, motion, inverse_dynamics(degraded_arm, motion), temp=np.outer(30.0 + motion.t, [1.0, 1.0])
    )
    columns = degraded(degraded_arm, warm, fault(degraded_arm, "temperature_dependent_friction")).columns
    v = motion.v[:, 1]
    wanted = (0.3 - 0.01 * (5.0 + motion.t)) * np.sign(v) + 0.1 * v
    found = columns["tau.elbow"] - table.columns["tau.elbow"]
    moving = np.abs(v) > 0.05
    np.testing.assert_allclose(found[moving], wanted[moving], atol=1e-3)
    np.testing.assert_array_equal(columns["temp.elbow"], warm.columns["temp.elbow"])


def test_a_delayed_drive_has_to_be_asked_earlier(degraded_arm, clean):
    # Known truth: the torque of the same motion 6 ms later.
    out = degraded(degraded_arm, clean[1], fault(degraded_arm, "input_delay")).columns["tau.elbow"]
    later = inverse_dynamics(degraded_arm, swinging(ahead=0.006))[:, 1]
    error = np.abs(out - later)[250:-250]
    assert np.quantile(error, 0.95) < 0.003 * np.abs(later).max()


def test_a_weak_motor_has_to_be_asked_for_more(degraded_arm, clean):
    # Contract: true torque = ratio * logged torque.
    out = degraded(degraded_arm, clean[1], fault(degraded_arm, "torque_constant", ratio=0.8)).columns["tau.elbow"]
    np.testing.assert_allclose(0.8 * out[250:-250], clean[1].columns["tau.elbow"][250:-250], atol=0.03)


def test_drives_make_up_for_friction_too(degraded_arm, clean):
    # Known truth: a weak motor needs more for the friction that came with it, whichever is named first.
    friction, weak = fault(degraded_arm, "viscous_friction"), fault(degraded_arm, "torque_constant", ratio=0.5)
    first, second = (
        degraded(degraded_arm, clean[1], *faults).columns["tau.elbow"]
        for faults in ((friction, weak), (weak, friction))
    )
    alone = degraded(degraded_arm, clean[1], friction).columns["tau.elbow"]
    # Steps of the modelled friction are smoothed.
    assert np.quantile(np.abs(0.5 * first - alone), 0.98) < 0.02
    np.testing.assert_allclose(first, second, atol=1e-9)


def test_a_held_torque_is_changed_by_its_mean_until_the_next_sample(degraded_arm, clean):
    # Closed form: an offset that grows linearly would be half a sample ahead.
    motion, table = clean
    held = replace(degraded_arm, torque_hold="zoh")
    spring = fault(degraded_arm, "parasitic_spring", stiffness=3.0, rest_position=0.0)
    out = degraded(held, table, spring).columns["tau.elbow"] - table.columns["tau.elbow"]
    later = 0.5 * (motion.q[:-1, 1] + motion.q[1:, 1])
    np.testing.assert_allclose(out[100:-101], 3.0 * later[100:-100], atol=2e-4)


@pytest.mark.parametrize("effect", READINGS)
def test_an_encoder_changes_what_is_read_and_no_torque(degraded_arm, clean, effect):
    motion, table = clean
    out = degraded(degraded_arm, table, fault(degraded_arm, effect)).columns
    q = motion.q[:, 1]
    expected = {
        "encoder_offset": q + 0.05,
        "encoder_eccentricity": q + 0.02 * np.sin(q + 0.4),
        "encoder_quantization": np.round(q / 0.01) * 0.01,
    }
    np.testing.assert_allclose(out["q.elbow"], expected[effect], atol=1e-12)
    np.testing.assert_array_equal(out["q.shoulder"], table.columns["q.shoulder"])
    np.testing.assert_array_equal(out["tau.elbow"], table.columns["tau.elbow"])


def test_the_velocity_is_that_of_the_eccentric_reading(degraded_arm, clean):
    motion, table = clean
    out = degraded(degraded_arm, table, fault(degraded_arm, "encoder_eccentricity")).columns["v.elbow"]
    expected = motion.v[:, 1] * (1 + 0.02 * np.cos(motion.q[:, 1] + 0.4))
    np.testing.assert_allclose(out[2:-2], expected[2:-2], atol=1e-4)


def test_a_limited_drive_moves_the_robot_otherwise(degraded_arm, clean):
    # Known truth: where the command is beyond the limit, the new motion needs just the limit.
    motion, table = clean
    limit = 0.7 * np.abs(table.columns["tau.elbow"]).max()
    out = degraded(degraded_arm, table, fault(degraded_arm, "torque_saturation", limit=limit)).columns
    tau, q = (np.column_stack([out[f"{name}.{j}"] for j in degraded_arm.joint_names]) for name in ("tau", "q"))
    v, a = np.gradient(q, motion.t, axis=0), np.gradient(np.gradient(q, motion.t, axis=0), motion.t, axis=0)
    needed = inverse_dynamics(degraded_arm, Motion(motion.t, q, v, a))
    assert np.abs(q - motion.q).max() > 0.01
    given = np.column_stack([tau[:, 0], np.clip(tau[:, 1], -limit, limit)])
    beyond = np.abs(tau[:, 1]) > 1.05 * limit
    assert beyond.mean() > 0.02
    error = np.abs(needed - given)[50:-50]
    assert np.quantile(error, 0.9) < 0.05 * limit


def test_a_limit_that_is_never_reached_changes_nothing(degraded_arm, clean):
    out = degraded(degraded_arm, clean[1], fault(degraded_arm, "torque_saturation", limit=1000.0))
    assert out.notes == ("the recorded motion never needs more torque than the limit: nothing is clipped",)
    for name, values in clean[1].columns.items():
        np.testing.assert_allclose(out.columns[name], values, atol=1e-12)


def test_current_and_voltage_go_with_the_torque(degraded_arm, clean):
    # Contract: tau = i k n, and the voltage's current over the resistance.
    motion, table = clean
    drive = replace(degraded_arm.actuators[1], torque_constant=0.05, gear_ratio=50.0, resistance=2.0)
    robot = replace(degraded_arm, actuators=(degraded_arm.actuators[0], drive))
    more = {"i.elbow": table.columns["tau.elbow"] / 2.5, "u.elbow": 0.0 * motion.t}
    out = degraded(robot, replace(table, columns={**table.columns, **more}), fault(robot, "torque_offset")).columns
    np.testing.assert_allclose(out["i.elbow"] - more["i.elbow"], -0.3 / 2.5, atol=1e-12)
    np.testing.assert_allclose(out["u.elbow"], -0.3 / 2.5 * 2.0, atol=1e-12)


def test_a_current_that_no_constant_explains_is_left_out_with_a_note(degraded_arm, clean):
    table = replace(clean[1], columns={**clean[1].columns, "i.elbow": clean[1].columns["tau.elbow"]})
    out = degraded(degraded_arm, table, fault(degraded_arm, "torque_offset"))
    assert "i.elbow" not in out.columns
    assert out.notes == ("i.elbow left out: the robot states no constants that tell what it would have been",)


@pytest.mark.parametrize("effect", ["backlash", "transmission_compliance"])
def test_a_second_encoder_sees_the_link_move(degraded_arm, clean, effect):
    # Known truth: within half the gap, or the transmitted torque over the stiffness.
    motion, table = clean
    table = replace(table, columns={**table.columns, "x.elbow": motion.q[:, 1]})
    out = degraded(degraded_arm, table, fault(degraded_arm, effect)).columns
    moved = np.abs(out["x.elbow"] - motion.q[:, 1])[100:-100].max()
    assert moved == pytest.approx(0.001, rel=1e-6) if effect == "backlash" else 1e-3 < moved < 0.05


def test_a_log_at_uneven_times_is_changed_at_its_own_times(degraded_arm, rng):
    motion = swinging()
    kept = np.sort(rng.choice(len(motion.t), len(motion.t) * 4 // 5, replace=False))
    part = Motion(motion.t[kept], motion.q[kept], motion.v[kept], motion.a[kept])
    table = table_of(degraded_arm, part, inverse_dynamics(degraded_arm, part))
    out = degraded(degraded_arm, table, fault(degraded_arm, "viscous_friction"))
    np.testing.assert_array_equal(out.columns["t"], part.t)
    change = out.columns["tau.elbow"] - table.columns["tau.elbow"]
    np.testing.assert_allclose(change[100:-100], 0.4 * part.v[100:-100, 1], atol=0.02)


def test_a_drive_in_front_of_a_torque_sensor_is_refused(degraded_arm, clean):
    with pytest.raises(
        ParameterError, match="input_delay on elbow cannot be put into this log: the torque columns come"
    ):
        degraded(replace(degraded_arm, torque_source="sensor"), clean[1], fault(degraded_arm, "input_delay"))


def test_a_play_behind_an_encoder_on_the_link_is_refused(degraded_arm, clean):
    robot = replace(degraded_arm, actuators=tuple(replace(a, encoder_side="link") for a in degraded_arm.actuators))
    with pytest.raises(ParameterError, match="backlash on elbow cannot be put into this log: the encoder sits on the"):
        degraded(robot, clean[1], fault(degraded_arm, "backlash"))


def test_a_ratio_of_zero_is_refused(degraded_arm, clean):
    with pytest.raises(ParameterError, match="ratio=0 of torque_constant is out of bounds: wanted ratio"):
        degraded(degraded_arm, clean[1], fault(degraded_arm, "torque_constant", ratio=0.0))


@pytest.mark.parametrize(("effect", "name"), [("input_delay", "delay"), ("actuator_lag", "time_constant")])
def test_a_drive_later_than_the_recording_is_long_is_refused(degraded_arm, clean, effect, name):
    with pytest.raises(ParameterError, match=rf"{name}=1000 s of {effect} is no shorter than the recording of"):
        degraded(degraded_arm, clean[1], fault(degraded_arm, effect, **{name: 1000.0}))


def test_a_torque_that_overflows_when_squared_is_refused(degraded_arm, clean):
    with pytest.raises(ParameterError, match="With these numbers the torque is not finite"):
        degraded(degraded_arm, clean[1], fault(degraded_arm, "viscous_friction", coefficient=1e300))


def test_a_robot_that_strays_from_its_motion_is_noted(degraded_arm, clean):
    notes = degraded(degraded_arm, clean[1], fault(degraded_arm, "torque_saturation", limit=0.0)).notes
    assert any("with these limits elbow strays" in note and "give higher ones" in note for note in notes)


def test_a_joint_without_a_torque_column_cannot_be_given_more(degraded_arm, clean):
    columns = {name: values for name, values in clean[1].columns.items() if name != "tau.elbow"}
    robot = replace(
        degraded_arm, actuators=(degraded_arm.actuators[0], replace(degraded_arm.actuators[1], actuated=False))
    )
    with pytest.raises(LogError, match=r"swing.csv has no torque of elbow, which needs another one: add tau\.elbow"):
        degraded(robot, replace(clean[1], columns=columns), fault(degraded_arm, "torque_offset"))


def test_what_no_diagnosis_will_see_is_noted(degraded_arm, clean):
    (note,) = degraded(degraded_arm, clean[1], fault(degraded_arm, "encoder_quantization")).notes
    assert note.startswith("a diagnosis will not see encoder_quantization in this log: no step is stated")
