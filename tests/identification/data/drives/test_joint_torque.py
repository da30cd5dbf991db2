"""Joint torque from what a drive reports: arrivals, warm motors."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.checks.check_recording import checked
from identification.data.drives.arrivals import arrival_notes, between_readings, with_unknown_arrivals
from identification.data.drives.joint_torque import external_torque
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from identification.data.signals import process
from identification.diagnosis.columns.operations import operation_of
from identification.identify.identify import identify
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.dynamics.kinematics import frame_pose
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

GAIN, PER_VOLT, FRAME, FINE = 24.0, 0.5, 0.02, 80  # V/rad, N m/V, s, steps of the oracle in a frame


def moving(t: np.ndarray) -> np.ndarray:
    return 0.6 * np.sin(1.9 * t) + 0.3 * np.sin(4.1 * t)


@pytest.fixture(scope="module")
def robot() -> Robot:
    """A rod on a motor of 0.5 N m/V whose references are held."""
    found = load_robot(ROBOTS / "pendulum.urdf")
    drive = replace(found.actuators[0], torque_constant=1.0, resistance=2.0)
    return replace(found, actuators=(drive,), reference_hold="zoh")


def servo(delay: float, drops_beyond: float = np.inf) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, motion and voltage at 4 kHz of a loop whose references are sent every frame and arrive later.

    Beyond an error it puts out no more than a volt.
    """
    t = np.arange(1000 * FINE + 1) * FRAME / FINE
    arrived = np.floor((t - delay) / FRAME + 1e-9) * FRAME
    q = 0.9 * moving(t - 0.1)
    error = moving(np.maximum(arrived, 0.0)) - q
    return t, q, np.where(np.abs(error) > drops_beyond, np.clip(GAIN * error, -1.0, 1.0), GAIN * error)


def read_once_a_frame(robot: Robot, delay: float, columns: dict | None = None, beyond: float = np.inf) -> Recording:
    t, q, u = (x[::FINE] for x in servo(delay, beyond))
    # In steps of a register.
    table = {"t": t, "q.pin": q, "q_ref.pin": moving(t), "u.pin": np.round(u, 2), **(columns or {})}
    return recording(Table("a.csv", table), robot)


@pytest.mark.parametrize("delay", [0.023, 0.031, 0.038])
def test_the_mean_of_a_frame_is_off_its_readings_by_a_part_of_a_frame(robot, delay):
    # The next reference comes at delay, and the line through the readings is of one that comes in whole frames.
    _, _, u = servo(delay)
    means = np.convolve(u, np.ones(FINE) / FINE, "same")[::FINE]
    one = read_once_a_frame(robot, delay)
    assert one.voltage is not None
    lines = np.convolve(one.voltage[:, 0], [0.125, 0.75, 0.125], "same")
    found = between_readings(one, robot, one.t, held=True)
    assert found is not None
    column = found.arrival[:, 0]
    part = delay / FRAME % 1.0 - 0.5
    inner = slice(20, -20)
    off = PER_VOLT * (means - lines) - part * column
    assert np.std(off[inner]) < 0.1 * 0.5 * np.std(column[inner])


@pytest.mark.parametrize("delay", [0.023, 0.031, 0.037])
def test_a_drive_that_protects_itself_is_followed_between_its_readings(robot, delay):
    # Where it drops its voltage in a frame, the line through the readings is off by up to 0.5 N m.
    _, _, u = servo(delay, 0.1)
    one = read_once_a_frame(robot, delay, beyond=0.1)
    assert one.voltage is not None
    means = np.convolve(u, np.ones(FINE) / FINE, "same")[::FINE]
    off = PER_VOLT * (means - np.convolve(one.voltage[:, 0], [0.125, 0.75, 0.125], "same"))
    found = between_readings(one, robot, one.t, held=True)
    assert found is not None
    left = off - found.torque[:, 0] - (delay / FRAME % 1.0 - 0.5) * found.arrival[:, 0]
    inner = slice(20, -20)
    assert np.std(left[inner]) < 0.4 * np.std(off[inner])
    # What is left lies where it is doubted.
    assert np.all(np.abs(left[inner]) < 3.0 * np.abs(found.nonlinear_std[inner, 0]) + 0.03)
    assert np.mean(np.abs(found.nonlinear_std) > 0.03) < 0.25


def test_a_drive_without_protection_leaves_no_doubt(robot):
    one = read_once_a_frame(robot, 0.031)
    found = between_readings(one, robot, one.t, held=True)
    assert found is not None
    assert not found.torque.any()
    assert not found.nonlinear_std.any()


def test_a_warm_motor_makes_less_of_it(robot):
    # By hand: 40 K above its coldest copper has 0.393 % times 40 more resistance.
    t = np.arange(1001) * FRAME
    cold, warm = (
        between_readings(read_once_a_frame(robot, 0.031, columns), robot, t, held=True)
        for columns in ({}, {"temp.pin": np.linspace(25.0, 65.0, len(t))})
    )
    assert cold is not None
    assert warm is not None
    np.testing.assert_allclose(warm.arrival[0], cold.arrival[0], atol=1e-12)
    np.testing.assert_allclose(warm.arrival[-1] * (1.0 + 0.00393 * 40.0), cold.arrival[-1], atol=1e-12)


def test_an_instant_reference_leaves_nothing_open(robot):
    one = read_once_a_frame(robot, 0.031)
    assert between_readings(one, robot, one.t, held=False) is None


def test_a_voltage_that_was_computed_leaves_nothing_open(robot):
    t = np.arange(1001) * FRAME
    one = read_once_a_frame(robot, 0.031, {"u.pin": GAIN * (moving(t) - 0.9 * moving(t - 0.1))})
    assert between_readings(one, robot, one.t, held=True) is None


def test_a_torque_in_place_of_a_voltage_leaves_nothing_open(robot):
    one = read_once_a_frame(robot, 0.031, {"tau.pin": np.sin(np.arange(1001) * FRAME)})
    assert between_readings(one, robot, one.t, held=True) is None


def test_the_joint_is_named_with_the_friction_that_looks_the_same(robot):
    # By hand: half a frame of 20 ms times 24 V/rad times 0.5 N m/V.
    one = read_once_a_frame(robot, 0.031)
    left_open = with_unknown_arrivals(robot, (process(one, robot),))
    (note,) = arrival_notes(left_open, (one,))
    assert left_open.unknown_arrivals == ("pin",)
    assert note.numbers["viscous"] == pytest.approx(0.01 * 24 * 0.5, rel=0.01)


def test_robots_whose_references_act_at_once_have_no_such_joint(robot):
    one = read_once_a_frame(replace(robot, reference_hold=None), 0.031)
    assert with_unknown_arrivals(robot, (process(one, replace(robot, reference_hold=None)),)).unknown_arrivals == ()


@pytest.fixture(scope="module")
def planar() -> Robot:
    return load_robot(ROBOTS / "planar2.urdf")


def test_a_force_on_the_elbow_turns_the_shoulder_alone(planar):
    # Closed form: hanging straight down, 3 N along x at the elbow, 0.5 m below the shoulder about y.
    found = external_torque(planar, np.zeros((1, 2)), {"lower": np.array([[3.0, 0.0, 0.0]])})
    np.testing.assert_allclose(found, [[-0.5 * 3.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize("name", ["arm3.urdf", "fourbar.xml", "parallelogram.urdf"])
def test_virtual_work_is_that_of_the_force(name):
    # Finite differences: the force's work over a small step of each driven joint.
    robot = load_robot(ROBOTS / name)
    frame = robot.model.frames[robot.model.nframes - 1].name
    q, force = 0.1 * np.ones((1, robot.nv)), np.array([[1.0, -2.0, 0.5]])
    found = external_torque(robot, q, {frame: force})[0]
    for j in range(robot.nv):
        step = 1e-6 * (np.arange(robot.nv) == j)
        ahead, behind = (frame_pose(robot, q + side * step, frame)[1][0] for side in (1, -1))
        assert found[j] == pytest.approx(float(force[0] @ (ahead - behind)) / 2e-6, abs=1e-6)


def test_the_drive_need_not_give_what_pushes(planar):
    t = np.arange(2000) / 200.0
    q = 0.4 * np.column_stack([np.sin(3 * t), np.cos(4 * t)])
    force = np.column_stack([np.sin(t), 0 * t, 2 * np.cos(t)])
    recording = Recording("a.csv", planar.joint_names, t, q, np.zeros_like(q), forces={"lower": force})
    log, bare = (process(r, planar, cutoff_hz=10.0) for r in (recording, replace(recording, forces={})))
    assert log.external is not None
    less = operation_of(planar, bare, ()).tau - operation_of(planar, log, ()).tau
    np.testing.assert_allclose(less, external_torque(planar, log.motion.q, {"lower": force}), atol=1e-12)


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        pytest.param("tool", r"f\.tool\.x, \.y and \.z are a force at a frame that planar2 does not have", id="frame"),
        pytest.param("lower", r"The force f\.lower is not finite at sample 1: give finite numbers", id="not finite"),
    ],
)
def test_a_force_at_an_unknown_frame_or_without_a_number_is_refused(planar, frame, said):
    with pytest.raises(LogError, match=said):
        external_torque(planar, np.zeros((2, 2)), {frame: np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])})


@pytest.fixture(scope="module")
def pushed(planar) -> Recording:
    """The arm in a motion under a measured force that takes most of its torque."""
    t = np.arange(2400) / 200.0
    w, size = np.array([2.1, 3.7]), np.array([0.6, 0.5])
    angle = np.outer(t, w)
    motion = Motion(t, size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle))
    force = {"lower": 60.0 * np.column_stack([np.sin(1.3 * t), 0 * t, np.cos(0.7 * t)])}
    tau = inverse_dynamics(planar, motion) - external_torque(planar, motion.q, force)
    noise = np.random.default_rng(0).standard_normal(tau.shape)
    return Recording("a.csv", planar.joint_names, t, motion.q, tau + 0.01 * noise, forces=force)


def test_an_identification_counts_measured_forces(planar, pushed):
    counted, not_counted = (identify(planar, (r,)).joints[0].rms for r in (pushed, replace(pushed, forces={})))
    assert counted < 0.02 < 1.0 < not_counted


def test_an_estimator_that_simulates_the_loop_refuses_measured_forces(planar, pushed):
    with pytest.raises(ParameterError, match=r"a\.csv has measured forces .* the estimator didim simulates the robot"):
        identify(planar, (pushed,), estimator="didim")


def test_a_check_against_the_model_counts_measured_forces(planar, pushed):
    # Closed form: a force along x at the elbow that gives the shoulder twice its torque, so that its drive holds back.
    needed = (pushed.tau + external_torque(planar, pushed.q, pushed.forces))[:, 0]
    along = -4.0 * needed / np.cos(pushed.q[:, 0])
    force = {"lower": np.column_stack([along, 0 * along, 0 * along])}
    tau = np.column_stack([-needed, (pushed.tau + external_torque(planar, pushed.q, pushed.forces))[:, 1]])
    held = replace(pushed, tau=tau, forces=force)
    stated = "the torque of shoulder has the opposite sign"
    assert not any(stated in sentence for sentence in checked(held, planar).warnings)
    assert any(stated in sentence for sentence in checked(replace(held, forces={}), planar).warnings)


def test_a_force_at_an_unknown_frame_is_refused_when_a_recording_is_read(planar):
    columns = {"t": np.arange(3.0)} | {f"f.hnd.{axis}": np.zeros(3) for axis in "xyz"}
    columns |= {f"{quantity}.{joint}": np.ones(3) for quantity in ("q", "tau") for joint in planar.joint_names}
    with pytest.raises(LogError, match=r"The columns f\.hnd\.x, \.y and \.z are a force at a frame"):
        recording(Table("a.csv", columns), planar)


def motionless(planar: Robot, q: float, compensated: dict[str, tuple[str, ...]]) -> Table:
    t = np.arange(60) / 100.0
    columns = {f"q.{joint}": np.full(60, q * (k == 0)) for k, joint in enumerate(planar.joint_names)}
    return Table("a.csv", {"t": t, **columns, **{f"tau.{j}": 0.1 + 0 * t for j in planar.joint_names}}, (), compensated)


def test_gravity_that_a_controller_had_taken_is_put_back(planar):
    # Closed form: the weights' moments about both joints, the arm stretched out 0.3 rad from hanging.
    masses, levers = [], []
    for k in (1, 2):
        body = planar.model.inertias[k]
        masses.append(body.mass)
        levers.append(-body.lever[2])
    length = -planar.model.jointPlacements[2].translation[2]
    elbow = masses[1] * 9.81 * levers[1] * np.sin(0.3)
    shoulder = elbow + (masses[0] * levers[0] + masses[1] * length) * 9.81 * np.sin(0.3)
    found = recording(motionless(planar, 0.3, {"": ("gravity",)}), planar)
    np.testing.assert_allclose(found.tau[0], [0.1 + shoulder, 0.1 + elbow], rtol=1e-9)
    assert "gravity torque was put back into the torque of shoulder, elbow" in found.warnings[0]


def test_gravity_is_put_back_into_the_joints_that_are_named(planar):
    found = recording(motionless(planar, 0.3, {"elbow": ("gravity",)}), planar)
    assert found.tau[0, 0] == 0.1
    assert found.tau[0, 1] > 0.2


def test_a_compensated_joint_that_the_robot_lacks_is_refused(planar):
    with pytest.raises(LogError, match=r"tau\.wrist is compensated, a joint that .* does not have"):
        recording(motionless(planar, 0.3, {"wrist": ("gravity",)}), planar)


@pytest.fixture
def voltage_driven(planar) -> Robot:
    """Both joints on motors of 1.2 N m/A and 3 ohm."""
    drives = tuple(replace(one, torque_constant=1.2, resistance=3.0) for one in planar.actuators)
    return replace(planar, actuators=drives)


def by_voltage(dropout: bool) -> Table:
    t = np.arange(1500) / 100.0
    q = 0.7 * np.column_stack([np.sin(2.0 * t), np.cos(1.3 * t)])
    q[700] = [-np.pi, -np.pi] if dropout else q[700]
    columns = {"t": t, "q.shoulder": q[:, 0], "q.elbow": q[:, 1]}
    return Table("u.csv", columns | {"u.shoulder": 4.0 * np.sin(2.2 * t), "u.elbow": 3.0 * np.cos(1.1 * t)})


def test_a_dropout_of_one_sample_is_none_of_the_back_emf(voltage_driven):
    # The same recording without it: 3.9 rad in a sample would be 0.48 N m s/rad times 390 rad/s.
    lost, whole = (recording(by_voltage(dropout), voltage_driven).tau for dropout in (True, False))
    assert lost is not None
    assert whole is not None
    np.testing.assert_allclose(lost, whole, atol=0.02)


def test_back_emf_is_that_of_the_filtered_positions(voltage_driven, rng):
    # Closed form: u kt/R less kt^2/R times the velocity of the motion, where noise of positions is none of the torque.
    table = by_voltage(dropout=False)
    noisy = {name: x + 1e-3 * rng.standard_normal(len(x)) if name[0] == "q" else x for name, x in table.columns.items()}
    log = process(recording(replace(table, columns=noisy), voltage_driven), voltage_driven, cutoff_hz=3.0)
    u = np.column_stack([table.columns["u.shoulder"], table.columns["u.elbow"]])
    np.testing.assert_allclose(log.tau, 0.4 * u - 0.48 * log.motion.v, atol=1e-9)


T = np.arange(1000) / 100.0

Q, V = np.sin(T), np.cos(T)

U = 3.0 * np.sin(2.0 * T)

K, R = 1.5, 2.0


@pytest.fixture(scope="module")
def warm_robot() -> Robot:
    found = load_robot(ROBOTS / "pendulum.urdf")
    return replace(found, actuators=(replace(found.actuators[0], torque_constant=K, resistance=R),))


def read(warm_robot: Robot, **columns: np.ndarray) -> Recording:
    return recording(Table("a.csv", {"t": T, "q.pin": Q, "v.pin": V, "u.pin": U, **columns}), warm_robot)


def test_copper_takes_its_part_of_current_and_back_emf(warm_robot):
    warm = np.linspace(25.0, 65.0, len(T))
    found = read(warm_robot, **{"temp.pin": warm})
    assert found.tau is not None
    np.testing.assert_allclose(found.tau[:, 0], K * (U - K * V) / (R * (1.0 + 0.00393 * (warm - 25.0))), rtol=1e-12)


def test_the_resistance_that_is_taken_is_said(warm_robot):
    # By hand: 2 ohm grow by 0.393 % times 40 K.
    (said,) = (
        one for one in read(warm_robot, **{"temp.pin": np.linspace(25.0, 65.0, len(T))}).warnings if "copper" in one
    )
    assert "to grow from the stated 2 to 2.31 ohm" in said


@pytest.mark.parametrize("warm", [31.0, 0.0])
def test_at_one_temperature_the_resistance_is_the_stated_one(warm_robot, warm):
    # One that was fitted is that of the motor as it ran.
    found = read(warm_robot, **{"temp.pin": np.full(len(T), warm)})
    np.testing.assert_array_equal(found.tau, read(warm_robot).tau)
    assert not any("copper" in one for one in found.warnings)


def test_a_measured_torque_does_not_depend_on_the_temperature(warm_robot):
    found = read(warm_robot, **{"tau.pin": U, "temp.pin": np.full(len(T), 80.0)})
    assert found.tau is not None
    np.testing.assert_array_equal(found.tau[:, 0], U)
    assert not any("copper" in one for one in found.warnings)


def test_a_computed_voltage_follows_its_reference_with_less_torque(warm_robot):
    # By hand: 24 V/rad times 0.75 N m/V, less by the copper's 0.393 % per K, on average.
    q_ref, warm = np.sin(T + 0.1), np.linspace(25.0, 65.0, len(T))
    found = read(warm_robot, **{"q_ref.pin": q_ref, "u.pin": 24.0 * (q_ref - Q), "temp.pin": warm})
    assert found.reference_gain is not None
    assert found.reference_gain[0] == pytest.approx(
        24.0 * K / R * np.mean(1.0 / (1.0 + 0.00393 * (warm - 25.0))), rel=1e-6
    )
