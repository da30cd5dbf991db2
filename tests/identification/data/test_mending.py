"""Recordings are mended and compensated, cut into stretches."""

import re
from dataclasses import replace

import numpy as np
import pytest

from identification.data.drives.compensation import put_back_sentences, without_low_pass
from identification.data.mending import mended, spikes, whole_turns
from identification.data.new_runs import with_jumps_excluded
from identification.data.reading import mended_and_checked, read_recording, recording
from identification.data.recording import Recording, Table
from identification.data.signals import low_pass, process, shortest_recording
from identification.data.stretches import busiest, note_on_length, stretches
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

T = np.arange(4000) / 500

TURNING, SLIDING = np.array([False]), np.array([True])


@pytest.fixture
def swinging(rng) -> Recording:
    """One joint that swings by three turns, with noise on its torque."""
    q = 9.0 * np.sin(2 * np.pi * 0.2 * T)[:, None]
    tau = np.sin(2 * np.pi * 0.7 * T)[:, None] + 0.02 * rng.standard_normal((len(T), 1))
    return Recording("a.csv", ("pin",), T, q, tau, q_ref=q + 0.01)


def wrapped(q: np.ndarray) -> np.ndarray:
    """An encoder that counts from -pi to pi."""
    return np.mod(q + np.pi, 2 * np.pi) - np.pi


def test_a_clean_recording_stays_as_it_is(swinging):
    assert mended(swinging, TURNING) is swinging


def test_the_turns_of_an_encoder_are_put_together(swinging):
    found = mended(replace(swinging, q=wrapped(swinging.q)), TURNING)
    np.testing.assert_allclose(found.q, swinging.q, atol=1e-12)
    # 9 sin(x) crosses pi and minus pi seven times in 1.6 periods, and no other odd multiple of pi.
    assert re.search(r"q of pin jumps by whole turns 7 times .*its turns were put together", found.warnings[0])


def test_a_file_of_such_an_encoder_is_read_with_its_turns_put_together(swinging, pendulum, tmp_path):
    columns = np.column_stack([swinging.t, wrapped(swinging.q), swinging.tau])
    np.savetxt(tmp_path / "a.csv", columns, delimiter=",", header="t,q.pin,tau.pin", comments="")
    np.testing.assert_allclose(read_recording(tmp_path / "a.csv", pendulum).q, swinging.q, atol=1e-12)


@pytest.mark.parametrize("read", [wrapped, np.array], ids=["wrapped too", "not wrapped"])
def test_a_reference_goes_along_where_it_was_wrapped_and_stays_where_not(swinging, read):
    found = mended(replace(swinging, q=wrapped(swinging.q), q_ref=read(swinging.q_ref)), TURNING)
    np.testing.assert_allclose(found.q_ref, swinging.q_ref, atol=1e-12)


def test_a_linear_joint_has_no_turns(swinging):
    far = replace(swinging, q=wrapped(swinging.q))
    assert mended(far, SLIDING) is far


def test_positions_in_degrees_have_no_turns_put_together(swinging):
    # Some 360 degrees a second: steps from sample to sample reach a whole number that looks like turns.
    q = np.rad2deg(9.0 * np.sin(2 * np.pi * 2.0 * T))
    assert np.abs(np.diff(q)).max() > 2 * np.pi
    assert len(whole_turns(q)[1]) == 0


@pytest.mark.parametrize("samples", [1, 3, 5])
@pytest.mark.parametrize("quantity", ["q", "tau"])
def test_a_spike_is_cut_out_and_reported_with_its_time(swinging, quantity, samples):
    broken = getattr(swinging, quantity).copy()
    broken[1000 : 1000 + samples] += 1.5
    found = mended(replace(swinging, **{quantity: broken}), TURNING)
    np.testing.assert_allclose(getattr(found, quantity), getattr(swinging, quantity), atol=0.1)
    stated = rf"1 spike or dropout of {samples} samples? in all \(at t = 2 s\): it was cut out"
    assert re.search(stated, found.warnings[0])


def test_a_dropout_to_zero_is_cut_out(swinging):
    broken = swinging.tau.copy()
    k = int(np.argmax(broken[:, 0] > 0.9))
    broken[k + 5 : k + 8] = 0.0
    assert mended(replace(swinging, tau=broken), TURNING).tau[k + 6, 0] > 0.8


def test_a_step_that_stays_is_no_spike(swinging):
    stepped = swinging.tau.copy()
    stepped[1000:] += 3.0
    assert spikes(stepped[:, 0], 0.1) == []


def test_friction_that_changes_sign_is_no_spike():
    v = np.cos(2 * np.pi * 3.0 * T)
    assert spikes(np.sign(v) + 0.1 * v, 0.1) == []


def test_a_recording_full_of_dropouts_stays_as_it_is(swinging):
    # Two samples in a hundred are no accident.
    broken = swinging.q.copy()
    for start in range(100, 3900, 240):
        broken[start : start + 5] += 2.0
    recording = replace(swinging, q=broken)
    assert len(spikes(broken[:, 0], 0.02)) == 16
    assert mended(recording, TURNING) is recording


@pytest.fixture
def stepping() -> Recording:
    """A joint that every second is kicked from rest to 2 rad/s within 3 ms, and slows down in 0.3 s."""
    t = np.arange(6000) / 1000
    after, kicks = t % 1.0, t > 0.5
    v = np.where(kicks, 2.0 * np.clip(1.0 - after / 0.3, 0.0, 1.0) * np.minimum(after / 0.003, 1.0), 0.0)
    tau = np.where(kicks & (after < 0.003), 100.0, np.where(kicks & (after < 0.3), -1.0, 0.0))
    return Recording("a.csv", ("pin",), t, np.cumsum(v)[:, None] / 1000, tau[:, None])


def test_a_torque_with_which_the_velocity_jumps_is_no_spike(stepping):
    assert len(spikes(stepping.tau[:, 0], 1.0)) == 5
    assert mended(stepping, TURNING) is stepping


def test_a_spike_without_a_jump_is_cut_out_beside_torques_that_make_one(stepping):
    broken = stepping.tau.copy()
    broken[2700:2702] = 100.0
    found = mended(replace(stepping, tau=broken), TURNING)
    np.testing.assert_allclose(found.tau, stepping.tau)
    assert "1 spike or dropout of 2 samples in all (at t = 2.7 s)" in found.warnings[0]


@pytest.fixture
def two_runs(planar: Robot) -> Recording:
    """Two runs of two joints in one file: the time goes on, and both joints are elsewhere from row 2000 on."""
    t = np.arange(4000) / 500
    q = np.column_stack([0.6 * np.sin(2 * t), 0.4 * np.cos(3 * t)])
    q[2000:] += np.array([0.3, -0.2])
    return Recording("a.csv", planar.joint_names, t, q, np.column_stack([np.cos(t), np.sin(t)]))


REVOLUTE = np.array([False, False])


def test_a_row_in_which_another_run_begins_is_a_break(two_runs):
    # Known truth: the second run begins in row 2000.
    found = with_jumps_excluded(two_runs, REVOLUTE)
    assert found.excluded == ((two_runs.t[1999], two_runs.t[2000]),)
    assert re.search(r"shoulder, elbow jump in one row \(at t = 4 s\): another run begins there", found.warnings[0])


def test_where_another_run_begins_no_encoder_is_accused(planar, two_runs):
    # The first joint jumps against its motion before and after, as an encoder does that starts anew.
    backwards = np.array(two_runs.q)
    backwards[:, 0] = np.where(two_runs.t < 4, 0.1, -0.4) * two_runs.t
    backwards[2000:, 0] += 2.4
    warnings = mended_and_checked(replace(two_runs, q=backwards), planar).warnings
    assert any("another run begins" in warning for warning in warnings)
    assert not any("encoder" in warning for warning in warnings)


def test_a_joint_that_jumps_alone_begins_no_run(two_runs):
    alone = np.array(two_runs.q)
    alone[2000:, 1] += 0.2
    jumping = replace(two_runs, q=alone)
    assert with_jumps_excluded(jumping, REVOLUTE) is jumping


@pytest.mark.parametrize("held", [25, 100])
def test_readings_that_are_held_or_stall_begin_no_run(planar, held):
    # Every reading is held for 25 rows; or readings of a smooth motion stall once, for 100 rows.
    t = np.arange(4000) / 500
    rows = np.arange(4000)
    rows = rows - rows % held if held == 25 else np.where((rows >= 2000) & (rows < 2100), 2000, rows)
    q = np.column_stack([0.6 * np.sin(2 * t), 0.4 * np.cos(3 * t)])[rows]
    smooth = Recording("a.csv", planar.joint_names, t, q, None)
    assert with_jumps_excluded(smooth, REVOLUTE) is smooth


def test_what_moves_between_two_rows_again_and_again_begins_no_run(planar):
    # A robot that steps from place to place within one row, every 20 rows.
    t = np.arange(4000) / 2
    places = np.random.default_rng(1).uniform(-1, 1, (200, 2))
    steps = Recording("a.csv", planar.joint_names, t, np.repeat(places, 20, axis=0), None)
    assert with_jumps_excluded(steps, REVOLUTE) is steps


RATE = 20.0


def made(
    seconds: float, moves: tuple[tuple[float, float], ...], gap: tuple[float, float] = (0.0, 0.0), rate: float = RATE
) -> Recording:
    """Two joints: the first swings now and then, the second only in these stretches."""
    t = np.arange(round(seconds * rate)) / rate
    t = t[(t < gap[0]) | (t >= gap[1])]
    swings = np.sin(t) * (t % 300.0 < 150.0)
    seldom = sum((np.sin(2 * t) * ((t >= a) & (t < b)) for a, b in moves), np.zeros(len(t)))
    return Recording("long.csv", ("often", "seldom"), t, np.column_stack([swings, seldom]), None, warnings=("one",))


def test_ten_minutes_are_used_from_end_to_end():
    recording = made(599.0, ())
    assert stretches(recording) == (recording,)
    assert busiest(recording) is recording


def test_two_hours_become_fifteen_stretches_from_beginning_to_end():
    parts = stretches(made(7200.0, ()))
    assert len(parts) == 15
    assert all(part.t[-1] - part.t[0] == pytest.approx(20.0, abs=2 / RATE) for part in parts)
    assert parts[0].t[0] < 480.0
    assert parts[-1].t[0] >= 14 * 480.0 - 20.0


@pytest.mark.parametrize("rate", [0.5, 2.0, 5.0])
def test_a_stretch_of_a_slow_recorder_has_samples_enough_for_a_fit(rate):
    # Oracle: what a recording must last by the band that its rate allows at most.
    parts = stretches(made(20 * 400 / rate, (), rate=rate))
    assert len(parts) == 15
    shortest = shortest_recording(low_pass(0.06 * rate, rate))
    assert all(part.t[-1] - part.t[0] > 1.9 * shortest for part in parts)


def test_a_slow_recording_of_few_samples_is_used_from_end_to_end():
    recording = made(2000.0, (), rate=2.0)
    assert stretches(recording) == (recording,)


def test_a_joint_that_moves_once_in_two_hours_is_in_a_stretch():
    parts = stretches(made(7200.0, ((3000.0, 3020.0),)))
    assert max(float(np.ptp(part.q[:, 1])) for part in parts) > 1.9


def test_a_stretch_has_the_temperatures_of_its_own_rows():
    whole = made(7200.0, ())
    warming = replace(whole, temperature=np.column_stack([whole.t, 2.0 * whole.t]))
    for part in stretches(warming):
        np.testing.assert_array_equal(part.temperature, np.column_stack([part.t, 2.0 * part.t]))


def test_every_stretch_is_one_in_which_a_joint_moves():
    assert all(np.ptp(part.q[:, 0]) > 0.5 for part in stretches(made(7200.0, ())))


def test_what_is_excluded_is_no_movement():
    recording = made(7200.0, ((3000.0, 3020.0),))
    excluded = Recording(
        recording.file, recording.joint_names, recording.t, recording.q, None, excluded=((2990.0, 3030.0),)
    )
    assert max(float(np.ptp(part.q[:, 1])) for part in stretches(excluded)) == 0.0


def test_a_pause_of_an_hour_gives_no_stretch():
    parts = stretches(made(7200.0, (), gap=(1000.0, 4600.0)))
    assert len(parts) == 15
    assert all(np.diff(part.t).max() < 0.1 for part in parts)


def test_warnings_stay_with_the_first_stretch():
    assert [len(part.warnings) for part in stretches(made(7200.0, ()))] == [1] + 14 * [0]


def test_the_busiest_five_minutes_hold_what_moves_once():
    part = busiest(made(7200.0, ((3000.0, 3020.0),)))
    assert part.t[-1] - part.t[0] == pytest.approx(300.0, abs=1.0)
    assert np.ptp(part.q[:, 1]) > 1.9


def test_the_note_says_what_is_used():
    assert note_on_length(made(7200.0, ())) == (
        "long.csv lasts 7200 s: fits and figures are of 15 stretches of 20 s from its beginning to its end, those in "
        "which the joints move most."
    )


@pytest.fixture
def swung(planar: Robot) -> Recording:
    """Ten seconds of two sines, with a torque that is a sine too."""
    t = np.arange(5000) / 500.0
    q = np.column_stack([0.6 * np.sin(2 * t), 0.4 * np.cos(3 * t)])
    return Recording("a.csv", planar.joint_names, t, q, np.column_stack([np.cos(t), np.sin(t)]))


@pytest.mark.parametrize("joints", [("shoulder", "elbow"), ("elbow",)])
def test_friction_is_put_back_with_the_velocities_of_the_log(planar, swung, joints):
    # Closed form: c v + T sign(v), with the log's own velocities.
    rubbing = replace(planar, viscous_friction=np.array([0.2, 0.1]), coulomb_friction=np.array([0.5, 0.3]))
    plain, put_back = (process(replace(swung, friction_subtracted=names), rubbing) for names in ((), joints))
    v = plain.motion.v
    wanted = (v * [0.2, 0.1] + np.sign(v) * [0.5, 0.3]) * np.isin(planar.joint_names, joints)
    np.testing.assert_allclose(put_back.tau - plain.tau, wanted, atol=1e-12)


def table(planar: Robot, compensated: dict[str, tuple[str, ...]]) -> Table:
    t = np.arange(60) / 100.0
    columns = {f"{x}.{joint}": 0.1 + t for x in ("q", "tau") for joint in planar.joint_names}
    return Table("a.csv", {"t": t, **columns}, (), compensated)


@pytest.mark.parametrize(
    ("compensated", "joints"),
    [
        ({"": ("friction",)}, ("shoulder", "elbow")),
        ({"elbow": ("gravity", "friction")}, ("elbow",)),
        ({"": ("gravity",), "shoulder": ("friction",)}, ("shoulder",)),
        ({"": ("gravity",)}, ()),
    ],
)
def test_a_recording_knows_from_which_torques_friction_was_taken(planar, compensated, joints):
    assert recording(table(planar, compensated), planar).friction_subtracted == joints


@pytest.mark.parametrize(
    ("coulomb", "said"),
    [
        (0.5, "the model's friction was put back into the torque of shoulder, from which a controller"),
        (0.0, "states none of shoulder, elbow: nothing was put back"),
    ],
    ids=["friction", "a model without"],
)
def test_what_is_put_back_is_said(planar, coulomb, said):
    robot = replace(planar, viscous_friction=np.zeros(2), coulomb_friction=np.array([coulomb, 0.0]))
    (sentence,) = put_back_sentences(table(planar, {"": ("friction",)}), robot)
    assert said in sentence


@pytest.mark.parametrize(("low_pass", "taken"), [({"": 5.0}, (5.0, 5.0)), ({"": 5.0, "elbow": 20.0}, (5.0, 20.0))])
def test_a_low_pass_is_taken_back(planar, low_pass, taken):
    # Closed form: of a sine a low pass of first order leaves 1 / sqrt(1 + (w T)^2), late by atan(w T).
    t, w = np.arange(5000) / 500.0, 7.0
    turns = w / (2 * np.pi * np.array(taken))
    behind = np.sin(w * t[:, None] - np.arctan(turns)) / np.sqrt(1 + turns**2)
    found, said = without_low_pass(replace(table(planar, {}), columns={"t": t}, low_pass=low_pass), planar, behind)
    np.testing.assert_allclose(found, np.sin(w * t)[:, None] * np.ones(2), atol=1e-4)
    assert f"the low pass at {taken[0]:g} Hz of shoulder, {taken[1]:g} Hz of elbow was taken back" in said[0]


def test_a_torque_that_was_recorded_late_is_taken_earlier(planar):
    # Closed form: each row has the torque of two rows, 20 ms, after it; the last one stays.
    found = recording(replace(table(planar, {}), late={"elbow": 0.02}), planar)
    np.testing.assert_allclose(found.tau[:, 0], 0.1 + found.t)
    np.testing.assert_allclose(found.tau[:, 1], 0.1 + np.minimum(found.t + 0.02, found.t[-1]))
    assert any("taken earlier by 20 ms of elbow, as the column map says" in text for text in found.warnings)


@pytest.mark.parametrize(
    ("stated", "said"),
    [({"late": {"wrist": 0.02}}, "was recorded late"), ({"low_pass": {"wrist": 20.0}}, "went through a low pass")],
)
def test_a_late_or_low_passed_torque_of_a_joint_that_the_robot_lacks_is_refused(planar, stated, said):
    with pytest.raises(LogError, match=rf"tau\.wrist {said}, a joint that .* does not have"):
        recording(replace(table(planar, {}), **stated), planar)


def test_names_with_a_prefix_of_all_joints_are_refused_with_the_map_that_reads_them(planar):
    # Known truth: the log calls every joint left_<joint>.
    plain = table(planar, {})
    prefixed = replace(plain, columns={name.replace(".", ".left_"): x for name, x in plain.columns.items()})
    with pytest.raises(LogError, match=r'write \{q: "q\.left_\{joint\}", tau: "tau\.left_\{joint\}"\}'):
        recording(prefixed, planar)
    one = replace(
        plain, columns={"q.left_elbow" if name == "q.elbow" else name: x for name, x in plain.columns.items()}
    )
    with pytest.raises(LogError, match=r"give one of these joints\.$|did you mean elbow\?$"):
        recording(one, planar)


def test_a_recording_has_its_torque_as_it_was_before_the_low_pass(planar):
    # Closed form: a ramp comes out of a low pass late by its time constant.
    found = recording(replace(table(planar, {}), low_pass={"elbow": 1 / (2 * np.pi * 0.03)}), planar)
    np.testing.assert_allclose(found.tau - 0.1 - found.t[:, None], [[0.0, 0.03]] * 60, atol=1e-9)
