"""Estimators in the closed loop."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from identification.data.log import Band, Log
from identification.data.recording import Recording
from identification.data.signals import process
from identification.estimators.closed_loop.didim import didim
from identification.estimators.closed_loop.loop import Feedback, feedback_of, loop_of, simulated
from identification.estimators.closed_loop.plant import plant_of
from identification.estimators.fit import Fit
from identification.estimators.iv import hausman_test, iv
from identification.regression.regressor import Regressor, gap_regressor, torque_regressor
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import EstimationError, IdentifiabilityError, LogError, ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller, Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate
from places import ROBOTS

# M, Fv, Fc; then the errors of position, velocity, acceleration and force [%].
PUBLISHED = np.array([95.1089, 203.5034, 20.3935])

PUBLISHED_ERRORS = np.array([0.0138, 0.229, 8.60, 5.85])

KP, KV, GAIN = 160.18, 243.45, 35.1507  # [1/s], [V s/m], [N/V]


@pytest.fixture(scope="module")
def raw(data_folder: Path) -> dict[str, np.ndarray]:
    return dict(np.load(data_folder / "emps" / "emps_train.npz"))


@pytest.fixture(scope="module")
def regressor(raw) -> Regressor:
    emps = load_robot("emps")
    q, force, q_ref = (raw[name][:, None] for name in ("q_meas", "force", "q_ref"))
    recording = Recording("emps", emps.joint_names, raw["t"], q, force, q_ref=q_ref)
    names = ("viscous_friction", "coulomb_friction", "torque_offset")
    return torque_regressor(emps, process(recording, emps), [(effect_named(name), "axis") for name in names])


def feedback(delay: float = 0.0) -> Feedback:
    """The recorded controller: the velocity is the backward difference of the mean of two samples."""
    kd = np.array([KV * GAIN])
    return Feedback(KP * kd, kd, np.array([10 * GAIN]), delay, held=True, window=2)


@pytest.fixture(scope="module")
def by_instruments(regressor) -> Fit:
    return iv(regressor, feedback=feedback())


@pytest.fixture(scope="module")
def by_simulation(regressor) -> Fit:
    return didim(regressor, feedback=feedback())


def simulation_errors(regressor: Regressor, raw: dict, fit: Fit, delay: float) -> np.ndarray:
    """Errors of position, velocity, acceleration and force [%] as the authors define them."""
    loop = loop_of(regressor.robot, regressor.logs[0], feedback(delay))
    motion, tau = simulated(loop, plant_of(regressor, fit.base, fit.theta))
    q, v, force = motion.q[:, 0], motion.v[:, 0], tau[:, 0]
    M, viscous, dry, offset = fit.theta
    # Theirs is the acceleration at the instant of a sample, where a held force has just changed.
    a = (force - viscous * v - dry * np.sign(v) + offset) / M
    position = filtfilt(*butter(4, 100 / 500), raw["q_meas"])
    velocity = np.gradient(position, 1e-3)
    measured = (position, velocity, np.gradient(velocity, 1e-3), raw["force"])
    pairs = zip(measured, (q, v, a, force), strict=True)
    return np.array([100 * np.linalg.norm((x - y)[49:]) / np.linalg.norm(x[49:]) for x, y in pairs])


def test_instruments_find_the_published_mass_and_friction_within_one_per_cent(by_instruments):
    np.testing.assert_allclose(by_instruments.theta[:3], PUBLISHED, rtol=0.01)


def test_direct_and_inverse_finds_the_published_mass_and_friction_within_one_per_cent(by_simulation):
    np.testing.assert_allclose(by_simulation.theta[:3], PUBLISHED, rtol=0.01)


def test_the_controller_that_we_simulate_is_the_recorded_one(raw):
    # Known truth: the recorded voltage, from recorded reference and position, to its noise of 0.2 %.
    q = raw["q_meas"]
    u = KP * KV * (raw["q_ref"] - q)[2:] - KV * (q[2:] - q[:-2]) / 2e-3
    assert np.std((u - raw["u_volt"][2:])[10:]) < 0.004 * np.std(raw["u_volt"])


@pytest.mark.parametrize("name", ["by_instruments", "by_simulation"])
def test_a_controller_late_by_one_sample_has_the_published_simulation_errors(name, regressor, raw, request):
    # Published, within 20 %; of the position a tenth: 0.0138 % of 0.149 m are 0.02 mm, for which this controller
    # asks for 28 N, and the published error of the force is 3 N.
    errors = simulation_errors(regressor, raw, request.getfixturevalue(name), delay=1e-3)
    np.testing.assert_allclose(errors, PUBLISHED_ERRORS * [0.1, 1, 1, 1], rtol=0.2)


@pytest.mark.parametrize("name", ["by_instruments", "by_simulation"])
def test_the_recorded_controller_beats_every_published_simulation_error(name, regressor, raw, request):
    errors = simulation_errors(regressor, raw, request.getfixturevalue(name), delay=0.0)
    assert np.all(errors < 0.8 * PUBLISHED_ERRORS)


def test_the_fine_encoder_does_not_bias_least_squares_by_much(regressor):
    # Published: least squares and instrumental variables agree on this axis.
    assert np.all(np.abs(hausman_test(regressor, feedback=feedback()).difference[:3]) < 0.005 * PUBLISHED)


FITS = [iv, didim]

RUBS = 0.6


def controlled(robot: Robot, kp: float = 60.0, kd: float = 8.0) -> Robot:
    actuators = tuple(replace(a, controller=Controller("pd", kp, kd)) for a in robot.actuators)
    return replace(robot, actuators=actuators)


def recorded(robot: Robot, seconds: float, size: float = 0.5, *, name: str = "made") -> Log:
    """A robot with viscous friction that its model lacks, under the controllers that it states."""
    t = np.arange(round(seconds / 5e-3)) * 5e-3
    wave = np.sin(2.1 * t) + 0.4 * np.sin(5.3 * t) + 0.2 * np.sin(11.0 * t)
    q_ref = size * wave[:, None] * (1 + 0.2 * np.arange(robot.nv))
    stated = feedback_of(robot)
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=stated.kp, kd=stated.kd)
    causes = tuple(Cause(effect_named("viscous_friction"), joint, np.array([RUBS])) for joint in robot.joint_names)
    moved = simulate(robot, causes, law, t, q_ref[0])
    motion = Motion(t, moved.q, moved.encoders.v, moved.encoders.a)
    everything = Band(200.0, 100.0, np.ones(1), 1)
    return Log(name, robot.joint_names, motion, moved.tau, everything, np.ones(len(t), bool), moved.q, q_ref)


def equations(robot: Robot, *logs: Log) -> Regressor:
    return gap_regressor(robot, logs, [(effect_named("viscous_friction"), joint) for joint in robot.joint_names])


@pytest.fixture(scope="module")
def pendulum() -> Robot:
    return controlled(load_robot(ROBOTS / "pendulum.urdf"))


@pytest.fixture(scope="module")
def swing(pendulum) -> Log:
    return recorded(pendulum, 4.0)


@pytest.mark.parametrize("fit", FITS)
def test_one_joint_is_enough(fit, pendulum, swing):
    assert fit(equations(pendulum, swing)).theta[0] == pytest.approx(RUBS, rel=0.02)


@pytest.mark.parametrize("fit", FITS)
def test_hinges_and_a_slide_work_alike(fit):
    arm = controlled(load_robot(ROBOTS / "arm3.urdf"), kp=400.0, kd=60.0)
    np.testing.assert_allclose(fit(equations(arm, recorded(arm, 3.0, 0.2))).theta, RUBS, rtol=0.05)


@pytest.mark.parametrize("fit", FITS)
def test_recordings_may_differ_in_length(fit, pendulum, swing):
    found = fit(equations(pendulum, swing, recorded(pendulum, 1.5, 0.3, name="short")))
    assert found.theta[0] == pytest.approx(RUBS, rel=0.02)


@pytest.mark.parametrize("fit", FITS)
def test_no_references_are_refused(fit, pendulum, swing):
    with pytest.raises(LogError, match=r"made has no references: record q_ref.<joint> of every joint, or use an esti"):
        fit(equations(pendulum, replace(swing, q_ref=None)))


@pytest.mark.parametrize("fit", FITS)
def test_a_reference_that_is_no_number_is_refused(fit, pendulum, swing):
    wanted = np.array(swing.q_ref)
    wanted[7] = np.nan
    with pytest.raises(LogError, match=r"q_ref.pin is not finite at sample 7"):
        fit(equations(pendulum, replace(swing, q_ref=wanted)))


@pytest.mark.parametrize("fit", FITS)
def test_a_robot_that_states_no_controller_is_refused(fit, swing):
    bare = load_robot(ROBOTS / "pendulum.urdf")
    with pytest.raises(ParameterError, match=r"states no controller of pin: add controller: \{kind: pd"):
        fit(equations(bare, swing))


def test_a_gain_of_the_wrong_sign_is_refused():
    one = np.ones(1)
    with pytest.raises(ParameterError, match=r"kp of the controllers is \[-60\.\]: give numbers of 0 or more"):
        Feedback(-60.0 * one, one, np.inf * one)


def test_gains_for_another_robot_are_refused(pendulum, swing):
    two = np.ones(2)
    with pytest.raises(ParameterError, match="There are 2 controllers for 1 joints: give one for each"):
        iv(equations(pendulum, swing), feedback=Feedback(two, two, np.inf * two))


@pytest.mark.parametrize("fit", FITS)
def test_a_loop_that_is_not_stable_is_refused(fit, pendulum, swing):
    # A hundred times the stiffness, half a second late.
    loop = Feedback(np.full(1, 6000.0), np.full(1, 8.0), np.full(1, np.inf), delay=0.5)
    with pytest.raises((EstimationError, IdentifiabilityError), match=r"check (the|references and) controllers"):
        fit(equations(pendulum, swing), feedback=loop)


@pytest.mark.parametrize("fit", FITS)
def test_torque_of_the_wrong_sign_gives_no_fit_that_says_nothing(fit, pendulum, swing):
    # The parameters of a torque with the wrong sign cannot move the robot: refused, or named as impossible.
    regressor = torque_regressor(pendulum, replace(swing, tau=-swing.tau), [(effect_named("viscous_friction"), "pin")])
    try:
        said = " ".join(fit(regressor).warnings)
    except (EstimationError, IdentifiabilityError, LogError) as error:
        said = str(error)
    assert (
        "controllers" in said
        or "the other sign is nearer: write tau.pin: {from: tau.pin, sign: -1}" in said
        or "which is impossible" in said
        or "check its sign and gain" in said
    )


@pytest.mark.parametrize("fit", FITS)
def test_a_robot_at_rest_without_weight_is_refused(fit):
    arm = controlled(load_robot(ROBOTS / "pendulum.urdf"))
    t = np.arange(100) * 5e-3
    still = Motion(t, *np.zeros((3, 100, 1)))
    log = Log("still", arm.joint_names, still, np.zeros((100, 1)), Band(200.0, 100.0, np.ones(1), 1),
              np.ones(100, bool), still.q, still.q)  # fmt: skip
    with pytest.raises(IdentifiabilityError, match=r"excites none of the 1 parameters"):
        fit(equations(arm, log))


@pytest.mark.parametrize("fit", FITS)
def test_two_samples_are_too_few(fit, pendulum, swing):
    motion = Motion(*(getattr(swing.motion, name)[:2] for name in "tqva"))
    short = replace(swing, motion=motion, tau=swing.tau[:2], valid=swing.valid[:2], raw_q=None, q_ref=swing.q_ref[:2])
    regressor = torque_regressor(pendulum, short, [(effect_named("viscous_friction"), "pin")])
    with pytest.raises(IdentifiabilityError, match=r"leave no equation to judge the noise by: record more"):
        fit(regressor)


@pytest.mark.parametrize("fit", FITS)
def test_an_effect_without_a_law_in_the_loop_is_refused(fit: Callable, pendulum, swing):
    regressor = gap_regressor(pendulum, swing, [(effect_named("load_dependent_friction"), "pin")])
    with pytest.raises(ParameterError, match="has no law for load_dependent_friction: leave it out, or use an estima"):
        fit(regressor)


@pytest.mark.parametrize("controller", [Controller(kp=20.0, reference_delay=0.03), Controller("duty", 20.0, limit=5.0)])
def test_a_controller_that_is_not_simulated_is_refused(controller):
    robot = load_robot(ROBOTS / "pendulum.urdf")
    robot = replace(robot, actuators=(replace(robot.actuators[0], controller=controller),))
    with pytest.raises(ParameterError, match="controllers of pin have late references or shares of a supply"):
        feedback_of(robot)
