"""Sines and speeds that stay the same, as people record first; known truth: friction in closed form."""

from dataclasses import replace

import numpy as np
import pytest

import phantom_dyn as dyn
from identification.data.recording import Recording
from identification.data.signals import process
from identification.diagnosis.columns.motion.standstill import standing_still
from identification.diagnosis.judge.strong_motion import _strong_up_to
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

SECONDS = 20.0


def sines(*hertz: float, rate: float = 200.0) -> Motion:
    t = np.arange(round(SECONDS * rate)) / rate
    w = 2 * np.pi * np.array(hertz)
    angle, amplitude = np.outer(t, w) + np.array(hertz), 0.6 / len(hertz)
    q, v, a = np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)
    return Motion(t, *(amplitude * part.sum(axis=1, keepdims=True) for part in (q, v, a)))


def chirp(rate: float = 200.0) -> Motion:
    """From 0.2 to 3 Hz."""
    t = np.arange(round(SECONDS * rate)) / rate
    rise = 2 * np.pi * 2.8 / SECONDS
    angle, w = 2 * np.pi * 0.2 * t + rise * t**2 / 2, 2 * np.pi * 0.2 + rise * t
    q, v = np.sin(angle), w * np.cos(angle)
    return Motion(t, *(0.6 * part[:, None] for part in (q, v, rise * np.cos(angle) - w**2 * np.sin(angle))))


def there_and_back() -> Motion:
    """At 0.6 rad/s, turned about within 0.2 s every 2 s."""
    t = np.arange(round(SECONDS * 1000)) / 1000
    window = np.hanning(200)
    v = 0.6 * np.convolve(np.sign(np.sin(0.5 * np.pi * t)), window / window.sum(), mode="same")
    q, a = np.cumsum(v) / 1000, np.gradient(v, 1e-3)
    return Motion(t[::5], *(part[::5, None] for part in (q, v, a)))


def recorded(robot: Robot, motion: Motion, lacking: np.ndarray | float) -> Recording:
    """The drive gives what the model lacks besides; noise of 0.025 N m."""
    rng = np.random.default_rng(1)
    tau = inverse_dynamics(robot, motion) + lacking + 0.025 * rng.standard_normal(motion.q.shape)
    return Recording("bench.csv", robot.joint_names, motion.t, motion.q + 1e-5 * rng.standard_normal(tau.shape), tau)


MOTIONS = {
    "one sine": sines(0.7),
    "two sines": sines(0.6, 1.7),
    "chirp": chirp(),
    "there and back": there_and_back(),
    "25 Hz": sines(0.5, 1.1, rate=25.0),
}
# All but the first at night: each is a whole diagnosis.
CASES = [
    pytest.param(motion, id=name, marks=() if name == "one sine" else pytest.mark.nightly)
    for name, motion in MOTIONS.items()
]


@pytest.mark.whole
@pytest.mark.parametrize("motion", CASES)
@pytest.mark.parametrize(("effect", "parameter", "size"), [("viscous_friction", "coefficient", 0.5)])
def test_friction_that_the_model_lacks_is_found_in_a_steady_motion(pendulum, motion, effect, parameter, size):
    (found,) = dyn.diagnose(pendulum, recorded(pendulum, motion, size * motion.v)).findings
    assert (found.effect, found.joint) == (effect, "pin")
    assert found.parameters[parameter].value == pytest.approx(size, rel=0.1)


@pytest.mark.whole
@pytest.mark.parametrize("motion", CASES)
def test_nothing_is_found_in_a_steady_motion_of_a_robot_as_modelled(pendulum, motion):
    diagnosis = dyn.diagnose(pendulum, recorded(pendulum, motion, 0.0))
    assert diagnosis.verdict in ("no_gap", "not_testable")
    assert not diagnosis.findings


@pytest.mark.whole
@pytest.mark.parametrize("hertz", [0.7, pytest.param(0.8, marks=pytest.mark.nightly)])
def test_one_sine_shows_friction_beside_inertia_which_has_rivals(pendulum, hertz):
    motion = sines(hertz)
    # Closed form: friction goes with the velocity, the rotor with the acceleration.
    diagnosis = dyn.diagnose(pendulum, recorded(pendulum, motion, 2.0 * motion.v + 0.25 * motion.a))
    found = {one.effect: one for one in diagnosis.findings}
    assert diagnosis.verdict == "explained"
    friction = found["viscous_friction"].parameters["coefficient"]
    assert friction.value == pytest.approx(2.0, abs=0.2)
    (other,) = set(found) - {"viscous_friction"}
    said = {other, *(one.effect for rival in found[other].rivals for one in rival.effects)}
    assert "rotor_inertia" in said
    assert len(said) > 1


@pytest.mark.whole
@pytest.mark.nightly
def test_no_torque_scale_is_certain_in_one_sine(pendulum):
    # Closed form: 0.5 N m s/rad and 0.25 kg m^2 make here, to a tolerance, what a scale of 1.7 makes of the torque.
    motion = sines(1.6)
    diagnosis = dyn.diagnose(pendulum, recorded(pendulum, motion, 0.5 * motion.v + 0.25 * motion.a))
    scales = [one for one in diagnosis.findings if one.effect == "torque_constant"]
    assert all(one.probability <= 0.85 and one.rivals for one in scales)


@pytest.mark.whole
def test_a_rhythm_in_time_beside_a_sine_of_another_frequency_stays_unknown(pendulum):
    motion = sines(0.7)
    hum = 0.6 * np.sin(2 * np.pi * 1.13 * motion.t)[:, None]
    assert dyn.diagnose(pendulum, recorded(pendulum, motion, hum)).verdict == "unknown"


@pytest.mark.parametrize("hertz", [1.0, 2.5])
def test_one_sine_is_no_standstill(pendulum, hertz):
    log = process(recorded(pendulum, sines(hertz), 0.0), pendulum)
    assert standing_still(log).mean() < 0.05


@pytest.mark.parametrize("rate", [25.0, 200.0])
def test_a_sine_on_each_joint_of_an_arm_is_no_standstill(rate):
    # Known truth: both joints move all the time, one ten rows a period; for a second of rest the arm stands.
    robot = load_robot(ROBOTS / "planar2.urdf")
    motion, other = sines(2.5, rate=rate), sines(0.8, rate=rate)
    both = Motion(motion.t, *(np.hstack([getattr(one, key) for one in (motion, other)]) for key in "qva"))
    rests = np.abs(both.t - 10.0) < 2.0
    moving = recorded(robot, both, 0.0)
    standing = replace(moving, q=np.where(rests[:, None], moving.q[rests][:1], moving.q))
    assert standing_still(process(moving, robot)).mean() < 0.05
    assert standing_still(process(standing, robot)).mean() > 0.05


def test_a_joint_on_a_coarse_encoder_stands_where_it_stands_and_not_between_its_steps(pendulum):
    # Known truth: it moves from 4 to 8 s and passes ten steps a second there.
    t = np.arange(2400) / 200.0
    way = 0.5 * np.clip(t - 4.0, 0.0, 4.0)
    readings = 0.05 * np.round(way / 0.05)[:, None]
    log = process(Recording("stairs.csv", pendulum.joint_names, t, readings, np.cos(t)[:, None]), pendulum)
    stands = standing_still(log)[:, 0]
    assert not stands[(t > 4.7) & (t < 7.3)].any()
    assert stands[(t > 1.0) & (t < 3.0) | (t > 9.0) & (t < 11.0)].all()


@pytest.mark.parametrize("harmonic", [0.0, 0.4])
def test_a_periodic_torque_is_strong_up_to_its_first_line(rng, harmonic):
    # Closed form: a sine, and the weight of a lever that swings far, which has its third harmonic.
    t = np.arange(4000) / 100.0
    torque = np.sin(2 * np.pi * 5.0 * t) + harmonic * np.sin(2 * np.pi * 15.0 * t)
    assert 5.0 < _strong_up_to(0.01 * rng.standard_normal(len(t)), torque, 100.0) < 8.0
