"""Reading recordings: files, logs, refusals, times."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.data.reading import read_recording, recording, unassigned_recording
from identification.data.recording import Fault, Recording, Table, time_text, when
from identification.data.refusal import fault_warnings, require_right, wrong_with
from identification.data.signals import low_pass
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Actuator
from phantom_dyn.motion import Motion

T = np.arange(100) * 0.01


def driven(arm, **constants):
    """The arm with the same drive on every joint."""
    return replace(arm, actuators=(Actuator(**constants),) * 3)


def table(**changes):
    """Columns of the three joints, in another order than the robot's; None leaves one out."""
    columns = {"t": T}
    for k, joint in enumerate(("slide", "turn", "tilt")):
        columns[f"q.{joint}"] = np.sin(T + k)
        columns[f"tau.{joint}"] = np.cos(T + k)
    columns |= {name.replace("__", "."): values for name, values in changes.items()}
    return Table("log.csv", {name: values for name, values in columns.items() if values is not None})


NO_TORQUE = {"tau__turn": None, "tau__tilt": None, "tau__slide": None}


def test_joints_stand_in_the_order_of_the_robot(arm):
    found = recording(table(), arm)
    assert found.joint_names == ("turn", "tilt", "slide")
    np.testing.assert_array_equal(found.q, np.column_stack([np.sin(T + 1), np.sin(T + 2), np.sin(T)]))
    np.testing.assert_array_equal(found.tau, np.column_stack([np.cos(T + 1), np.cos(T + 2), np.cos(T)]))


@pytest.mark.parametrize("name", ["t", "q", "tau"])
def test_arrays_cannot_be_written_to(arm, name):
    assert not getattr(recording(table(), arm), name).flags.writeable


def test_what_was_not_recorded_is_none(arm):
    found = recording(table(), arm)
    assert (found.v, found.current, found.voltage, found.q_ref, found.x, found.temperature) == (None,) * 6


def test_temperatures_stand_in_the_order_of_the_robot_and_some_joints_may_have_none(arm):
    found = recording(table(temp__slide=30.0 + T, temp__turn=40.0 + T), arm)
    np.testing.assert_array_equal(found.temperature[:, [0, 2]], np.column_stack([40.0 + T, 30.0 + T]))
    assert np.isnan(found.temperature[:, 1]).all()
    assert found.warnings == ()


def test_the_temperature_of_something_else_than_a_joint_is_left_out_with_a_warning(arm):
    found = recording(table(temp__case=30.0 + T), arm)
    assert found.temperature is None
    assert found.warnings == ("log.csv: temp.case not used: a temperature of something that is no joint.",)


def test_forces_are_collected_by_frame(arm):
    found = recording(table(f__tool__x=T, f__tool__y=2 * T, f__tool__z=3 * T), arm)
    np.testing.assert_array_equal(found.forces["tool"], np.column_stack([T, 2 * T, 3 * T]))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda arm: recording(table(f__tool__x=T, f__tool__y=T), arm),
            r"has no column f\.tool\.z: a force needs its three axes",
            id="a force without all axes",
        ),
        pytest.param(
            lambda arm: recording(table(q__tilf=T), arm),
            r"column q\.tilf is of the joint tilf, which .* did you mean tilt\?",
            id="an unknown joint lists the robots joints",
        ),
        pytest.param(
            lambda arm: recording(table(q__wrist=T, tau__wrist=T), arm),
            r"q\.wrist is of the joint wrist, .* To leave it out, write ignore: \[q\.wrist, tau\.wrist\] into",
            id="a log of more joints than the robot has gets the entry that leaves them out",
        ),
        pytest.param(
            lambda arm: recording(table(q__tilt=None, tau__tilt=None), arm),
            r"has no column q\.tilt, but arm3 has the joint tilt",
            id="a joint without position",
        ),
        pytest.param(
            lambda arm: recording(table(**NO_TORQUE), arm),
            r"no torque: there is no column tau\.turn, .* or the motor current i\.<joint>",
            id="no torque at all tells of currents",
        ),
        pytest.param(
            lambda arm: recording(table(**NO_TORQUE, v_ref__turn=T), arm),
            r"a velocity controller makes the torque kv \(v_ref - v\): write that into tau\.<joint>",
            id="references of velocity controllers have to be made a torque",
        ),
        pytest.param(
            lambda arm: recording(table(tau__tilt=None), arm),
            r"has no torque of tilt: add tau\.<joint>.* or say actuated: false",
            id="a joint without torque",
        ),
        pytest.param(
            lambda arm: recording(table(tau__turn=0 * T, tau__tilt=0 * T, tau__slide=0 * T), arm),
            "the torque is zero on every joint",
            id="torque zero on every joint",
        ),
        pytest.param(
            lambda arm: recording(table(tau__tilt=None, i__tilt=T), arm),
            r"has i\.tilt but no tau\.tilt, and the robot states no torque_constant of tilt",
            id="current without constant",
        ),
        pytest.param(
            lambda arm: recording(table(tau__tilt=None, u__tilt=T), driven(arm, torque_constant=0.05)),
            "the robot states no resistance of tilt",
            id="voltage without resistance",
        ),
    ],
)
def test_what_cannot_be_is_refused(arm, call, message):
    with pytest.raises(LogError, match=message):
        call(arm)


def test_columns_of_a_locked_joint_are_left_out_with_a_warning(arm):
    found = recording(table(q__gripper=T), replace(arm, locked=("gripper",)))
    assert found.warnings == ("log.csv: the columns of gripper are not used, as the robot holds it fixed.",)


def test_a_joint_without_drive_needs_no_torque(arm):
    passive = replace(arm, actuators=(Actuator(), Actuator(actuated=False), Actuator()))
    assert not recording(table(tau__tilt=None), passive).tau[:, 1].any()


def test_motion_alone_needs_no_torque(arm):
    assert recording(table(**NO_TORQUE), arm, torque_needed=False).tau is None


def test_torque_zero_on_one_joint_is_a_warning(arm):
    said = "torque of tilt is zero throughout: if the joint has no drive"
    assert said in recording(table(tau__tilt=0 * T), arm).warnings[0]


def test_torque_zero_on_a_joint_without_drive_is_no_warning(arm):
    passive = replace(arm, actuators=(Actuator(), Actuator(actuated=False), Actuator()))
    assert recording(table(tau__tilt=0 * T), passive).warnings == ()


def test_current_becomes_torque_by_constant_and_gear(arm):
    robot = driven(arm, torque_constant=0.06, gear_ratio=100.0)
    found = recording(table(tau__tilt=None, i__tilt=T), robot)
    np.testing.assert_allclose(found.tau[:, 1], 6.0 * T)


def test_measured_torque_goes_before_current(arm):
    found = recording(table(i__tilt=T), driven(arm, torque_constant=0.06))
    np.testing.assert_array_equal(found.tau[:, 1], np.cos(T + 2))


def test_voltage_becomes_torque_by_resistance_and_speed(arm):
    robot = driven(arm, torque_constant=0.05, gear_ratio=10.0, resistance=2.0)
    found = recording(table(tau__tilt=None, u__tilt=3 + T, v__tilt=4 * T), robot)
    np.testing.assert_allclose(found.tau[:, 1], (3 + T - 0.5 * 4 * T) / 2.0 * 0.5)


def test_voltage_without_speed_takes_that_of_the_position(arm):
    robot = driven(arm, torque_constant=0.05, gear_ratio=10.0, resistance=2.0)
    found = recording(table(tau__tilt=None, u__tilt=3 + T), robot)
    np.testing.assert_allclose(found.tau[1:-1, 1], ((3 + T - 0.5 * np.cos(T + 2)) / 2.0 * 0.5)[1:-1], atol=1e-5)


def test_velocity_of_some_joints_only_is_left_out_with_a_warning(arm):
    found = recording(table(v__tilt=T), arm)
    assert found.v is None
    assert found.warnings == ("log.csv: the columns v. are not used, as turn, slide has none.",)


def test_excluded_stretches_are_kept(arm):
    assert recording(table(), arm, excluded=[(0.1, 0.2), (0.9, 5)]).excluded == ((0.1, 0.2), (0.9, 5.0))


@pytest.mark.parametrize(
    ("stretch", "sentence"),
    [
        ((0.5, 0.2), r"0\.5:0\.2 ends before it begins"),
        ((2, 3), r"2:3 lies outside log\.csv, which goes from 0 s to 0\.99 s"),
    ],
)
def test_an_excluded_stretch_that_cannot_be_is_refused(arm, stretch, sentence):
    with pytest.raises(LogError, match=sentence):
        recording(table(), arm, excluded=[stretch])


def test_without_a_robot_the_joints_are_those_of_the_file():
    assert unassigned_recording(table()).joint_names == ("slide", "turn", "tilt")


def test_reading_a_recording_checks_it(arm, tmp_path):
    t = np.arange(2000) * 0.005
    columns = {"t": t}
    for k, joint in enumerate(arm.joint_names):
        columns |= {f"q.{joint}": 0.5 * np.sin(t * (k + 1)) * (t < 8), f"tau.{joint}": np.cos(t * (k + 1))}
    np.savez(tmp_path / "log.npz", **columns)
    assert any("no joint moves from t = 8.005 s" in w for w in read_recording(tmp_path / "log.npz", arm).warnings)


RATE = 200.0


def log_of(count: int, band: Band, invalid: tuple[int, ...] = ()) -> Log:
    zeros = np.zeros((count, 1))
    valid = np.ones(count, dtype=bool)
    valid[list(invalid)] = False
    return Log("made up", ("axis",), Motion(np.arange(count) / RATE, zeros, zeros, zeros), zeros, band, valid)


@pytest.mark.parametrize("cutoff", [3.0, 10.0, 37.0, 90.0])
@pytest.mark.parametrize("count", [400, 401, 403])
def test_a_ramp_comes_out_as_it_was_at_the_samples_that_are_named(cutoff, count):
    # Closed form: a symmetric kernel of sum one leaves a straight line, so there is no delay and no wrong index.
    log = log_of(count, low_pass(cutoff, RATE))
    ramp = 3.0 + 0.25 * np.arange(count)
    np.testing.assert_allclose(log.band(ramp), ramp[log.samples], rtol=1e-12)


@pytest.mark.parametrize("cutoff", [3.0, 10.0, 37.0])
def test_the_output_is_the_convolution_where_the_kernel_fits(rng, cutoff):
    # numpy.convolve, then every step-th sample.
    band = low_pass(cutoff, RATE)
    x = rng.normal(size=501)
    np.testing.assert_allclose(band(x), np.convolve(x, band.kernel, mode="valid")[:: band.step], atol=1e-12)


def test_every_axis_after_time_is_filtered_alike(rng):
    band = low_pass(10.0, RATE)
    x = rng.normal(size=(400, 2, 3))
    assert band(x).shape == (len(band.samples(400)), 2, 3)
    np.testing.assert_allclose(band(x)[:, 1, 2], band(x[:, 1, 2]), atol=1e-15)


@pytest.mark.parametrize(("hz", "gain"), [(4.0, 1.0), (10.0, 0.5), (25.0, 0.0)])
def test_the_edge_halves_and_what_is_above_is_gone(hz, gain):
    band = low_pass(10.0, RATE)
    response = band.kernel @ np.exp(-2j * np.pi * hz / RATE * np.arange(len(band.kernel)))
    assert abs(response) == pytest.approx(gain, abs=0.01)


def test_samples_whose_kernel_touches_an_invalid_one_are_invalid_and_no_others():
    # Brute force over every kernel.
    log = log_of(900, low_pass(10.0, RATE), invalid=(150, 151, 152, 600))
    half = log.band.half
    expected = [bool(log.valid[k - half : k + half + 1].all()) for k in log.samples]
    np.testing.assert_array_equal(log.valid_in_band, expected)
    assert not all(expected)


def test_the_arrays_of_a_log_cannot_be_written_to():
    log = log_of(40, low_pass(10.0, RATE))
    with pytest.raises(ValueError, match="read-only"):
        log.valid[0] = False


SECONDS = np.arange(100) / 100

WRONG = Recording(
    "a.csv", ("j1",), SECONDS, SECONDS[:, None], SECONDS[:, None],
    wrong=(Fault("q of j1 is in degrees", "it reaches 99 rad", "give unit: deg"), Fault("b", "c", "d")),
)  # fmt: skip


def test_a_wrong_recording_is_refused_with_what_to_do():
    stated = (
        r"^a\.csv: q of j1 is in degrees \(it reaches 99 rad\): give unit: deg; or judge it all the same with --anyway"
    )
    with pytest.raises(LogError, match=stated):
        require_right((WRONG,))


def test_further_faults_are_counted():
    with pytest.raises(LogError, match=r"\(1 more of this kind: phantom-dyn check tells it\)\.$"):
        require_right((WRONG,))


def test_a_wrong_recording_that_is_to_be_judged_anyway_is_not_refused():
    judged = replace(WRONG, anyway=True)
    require_right((judged,))
    assert wrong_with((judged,)) == ("a.csv: q of j1 is in degrees", "a.csv: b")


def test_what_is_wrong_is_said_with_the_file():
    assert wrong_with((WRONG,)) == ("a.csv: q of j1 is in degrees", "a.csv: b")
    assert fault_warnings((WRONG,))[0] == "a.csv: q of j1 is in degrees (it reaches 99 rad): give unit: deg."


@pytest.mark.parametrize(
    ("time", "text"),
    [(0.0, "0"), (2e-5, "2e-05"), (1.0400001, "1.04"), (123.4567, "123.457"), (2000.0, "2000"), (86400.25, "86400.25")],
)
def test_a_time_has_six_digits(time, text):
    assert time_text(time) == text


@pytest.mark.parametrize("time", [1.7e9, 1.7e9 + 0.123, 1732589710.5])
def test_a_time_since_1970_is_reported_to_the_millisecond(time):
    assert float(time_text(time)) == pytest.approx(time, abs=1e-3)
    assert "e" not in time_text(time)


def test_of_many_times_the_first_five_are_named():
    assert when(np.arange(7) / 2) == "at t = 0, 0.5, 1, 1.5, 2 s and 2 more"
