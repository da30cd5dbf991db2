"""Rollouts of both models: noise band, followed references."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.data.recording import Recording
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Judgement, Unexplained
from identification.pipeline import diagnose
from identification.rollout.compare import Errors, Rollout, WindowMotion, horizon_of
from identification.rollout.joint_limits import EngagedLimit, Simulated, limit_notes, limits_engaged, recorded_past
from identification.rollout.rollout import _without_gaps, motion_deviations, turning_torque, unknown_if_motion_deviates
from identification.rollout.rollout_starts import States, Window, exerted_torque, states_of, true_state
from identification.rollout.shots import under_torque
from identification.rollout.simulated_models import model_of, with_load
from identification.rollout.simulated_motion import with_simulated_motion
from identification.words.note_words import sentence, sentences
from phantom_dyn.dynamics.dynamics import inverse_dynamics, rigid_body_regressor
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator, Controller
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import torque_over_time
from phantom_dyn.simulation.simulate import Cause, simulate

WIDE = (
    ("coulomb_friction", "shoulder", 1.0),
    ("viscous_friction", "elbow", 0.8),
    ("rotor_inertia", "elbow", 0.2),
    ("payload", None, 1.0, 0.0, 0.0, -0.3),
    ("base_tilt", None, 0.0, 0.1, 0.0),
    ("torque_constant", "shoulder", 0.8),
    ("torque_saturation", "shoulder", 8.0),
    ("input_delay", None, 0.006),
    ("actuator_lag", "elbow", 0.006),
    ("encoder_offset", "elbow", 0.05),
    ("presliding_friction", "elbow", 1.0, 0.01),
    ("stribeck_friction", "shoulder", 0.5, 1.5, 0.2),
    ("parasitic_spring", "elbow", 5.0, 0.3),
)


def cause(effect: str, joint: str | None, *theta: float) -> Cause:
    return Cause(effect_named(effect), joint, np.array(theta))


def test_a_pendulum_let_go_follows_its_closed_form(pendulum, record):
    free = replace(pendulum, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))
    w = np.sqrt(2.0 * 9.81 * 0.5 / 0.6)
    made = record(free)
    t = made.log.motion.t
    swing = 0.01 * np.cos(w * t)[:, None]
    speed = -0.01 * w * np.sin(w * t)[:, None]
    states = replace(states_of(made.log, made.cutoff_hz), q=swing, v=speed, a=-(w**2) * swing, raw=swing)
    shot = replace(made.shots()[3], states=states)
    assert np.abs(under_torque(shot, model_of(free, ()), np.zeros((len(t), 1))) - shot.read).max() < 2e-7


@pytest.mark.parametrize("truth", WIDE, ids=lambda truth: truth[0])
def test_the_true_model_stays_near_the_recording_and_the_given_one_does_not(planar, record, truth):
    true = cause(*truth)
    found = record(planar, true).rollout(true)
    before, after = (np.linalg.norm(list(rms.values())) for rms in (found.rms_before, found.rms_after))
    assert found.horizon_s == 0.5
    assert after < 0.25 * before
    assert after < 2e-3


def test_without_a_gap_both_models_err_alike_and_little(planar, record):
    found = record(planar).rollout()
    assert found.rms_before == found.rms_after
    assert max(found.rms_after.values()) < 2e-3


@pytest.mark.parametrize(
    "truth",
    [("input_delay", None, 0.0132), ("actuator_lag", "elbow", 0.02), ("torque_constant", "elbow", 0.7),
     ("torque_saturation", "shoulder", 3.0)],
    ids=lambda truth: truth[0],
)  # fmt: skip
def test_drives_give_what_a_simulation_gives(planar, truth):
    t = np.arange(800) / 1000.0
    asked = np.column_stack([5.0 * np.sin(7.0 * t), 2.0 * np.cos(9.0 * t)])
    true = cause(*truth)
    measured = replace(planar, torque_source="sensor")
    # What a sensor has read is of the step before a sample: in the middle half a step earlier.
    given = simulate(measured, (true,), torque_over_time(t, asked), t, np.zeros(2), max_step=1e-3).tau
    ours = exerted_torque(model_of(planar, (true,)), t - 0.0005, asked)
    shifted = np.column_stack([np.interp(t - 0.0005, t, column) for column in ours.T])
    assert np.abs(shifted - given)[50:].max() < 0.02


def test_a_torque_that_acts_late_is_shifted_by_samples(planar):
    t = np.arange(100) / 100.0
    ramp = np.column_stack([t, 2.0 * t])
    late = exerted_torque(model_of(planar, (), late=0.5), t, ramp)
    np.testing.assert_allclose(late[1:], ramp[1:] - [0.005, 0.01], atol=1e-12)


def test_readings_are_undone_at_the_start(planar):
    wrong = (cause("encoder_eccentricity", "elbow", 0.02, 0.3, 1.0), cause("encoder_offset", "shoulder", 0.1))
    at = np.array([[0.5, 0.7]])
    read = States(at, np.array([[1.0, 2.0]]), 0.0 * at, at, *np.zeros((4, 2)))
    start = true_state(model_of(planar, wrong), read, 0, 0.01)
    assert start.q[0] == pytest.approx(0.4)
    assert start.q[1] + 0.02 * np.sin(start.q[1] + 0.3) == pytest.approx(0.7, abs=1e-9)
    assert start.v[1] * (1.0 + 0.02 * np.cos(start.q[1] + 0.3)) == pytest.approx(2.0, rel=1e-5)


def test_smoothed_states_are_better_than_the_readings(planar, record):
    noisy, clean = record(planar, noise=1e-3), record(planar, noise=1e-9)
    states = states_of(noisy.log, noisy.cutoff_hz)
    at = slice(200, 1800)
    error = (states.q - clean.log.raw_q)[at].std(axis=0)
    assert (error < 0.5e-3).all()
    assert (error < 2.0 * states.q_std).all()


def errors(grows: float) -> Errors:
    t = np.linspace(0.0, 0.5, 101)
    one = np.ones((101, 1))
    return Errors((t,), (0.01 * one,), (0.001 * one,), (1e-4 * np.exp(grows * t)[:, None],), (0.1 * one,))


def test_the_whole_horizon_is_taken_where_the_noise_stays_small():
    assert horizon_of(errors(1.0)) == 0.5


def test_the_horizon_ends_where_the_noise_of_the_start_has_grown():
    # The root mean square of 1e-4 exp(20 t) passes 0.05 of the travel, 5e-3, between 0.15 and 0.25 s.
    assert horizon_of(errors(20.0)) == 0.25


def window(file: str, t: float, read: float, given: float, corrected: float) -> Simulated:
    times = t + np.arange(5) / 100.0
    return Simulated(file, times, *(np.linspace(0.0, end, 5)[:, None] for end in (read, given, corrected)))


def test_limits_that_only_the_simulation_passes_are_reported_with_joint_and_time(pendulum):
    # Up to 3.5 rad in four equal steps of a hundredth of a second: past 3 rad after the last.
    passed, recorded = window("a.csv", 1.0, 2.98, 2.98, 3.5), window("a.csv", 2.0, 3.5, 3.5, 3.5)
    windows = (passed, recorded, window("b.csv", 4.0, 1, 1, 1))
    (one,) = limits_engaged(pendulum, windows)
    assert (one.model, one.joint, one.recording, one.limit, one.windows, one.of) == (
        "corrected", "pin", "a.csv", 3.0, 1, 2,
    )  # fmt: skip
    assert one.t == pytest.approx(1.04)
    (said,) = sentences(limit_notes(pendulum, (one,)))
    assert said.startswith(
        "a.csv: in 1 of 2 simulated windows pin runs past the limit of 3 rad of the corrected model, first at t = 1.04"
    )


def test_the_given_model_is_warned_of_only_where_the_corrected_one_keeps_the_limit(pendulum):
    both = limits_engaged(pendulum, (window("a.csv", 0.0, -3.0, -3.5, -3.5),))
    assert [one.model for one in both] == ["given", "corrected"]
    assert len(limit_notes(pendulum, both)) == 1
    assert "of the given model" in sentence(limit_notes(pendulum, both[:1])[0])


@pytest.mark.parametrize(("read", "near"), [(2.96, False), (2.98, True), (3.02, True), (3.04, False)])
def test_a_limit_that_the_recording_does_not_come_up_to_is_no_stop(pendulum, read, near):
    # By hand: limits of -3 and 3 rad, and 0.03 rad about them; a simulation that runs away passes any.
    assert bool(limits_engaged(pendulum, (window("a.csv", 0.0, read, 9.0, 2.0),))) is near


def test_a_recording_past_the_limits_of_its_model_is_reported(pendulum, record):
    made = record(pendulum)
    q = np.array(made.log.raw_q)
    q[500:510, 0] = 3.1
    (said,) = sentences(recorded_past(pendulum, (replace(made.log, raw_q=q),)))
    assert said.startswith("sim.csv: pin goes up to 0.1 rad past the model's limits of -3 to 3 rad, first at t = 2 s")
    assert "counts pin from another zero, write q.pin: {from: q.pin, offset: ...} into a column map" in said
    assert "or sign: -1 or a unit if those are wrong; else correct the limits in the robot file." in said
    assert recorded_past(pendulum, (made.log,)) == ()


def test_a_motor_without_inertia_cannot_be_simulated_apart(pendulum, record):
    made = record(pendulum)
    with pytest.raises(ParameterError, match="has no rotor inertia"):
        made.rollout(cause("backlash", "pin", 0.01))


def test_windows_keep_off_samples_that_must_not_be_used(planar, record):
    made = record(planar)
    valid = made.log.valid.copy()
    valid[900:905] = False
    shots = replace(made, log=replace(made.log, valid=valid)).shots(count=50)
    assert shots
    for shot in shots:
        assert valid[shot.window.start - shot.window.lead : shot.window.stop].all()


def test_under_its_controller_the_true_model_stays_near_the_recording(planar, record):
    stated = replace(planar, actuators=(Actuator(controller=Controller(kp=300.0, kd=30.0)),) * 2)
    true = cause("coulomb_friction", "shoulder", 3.0)
    found = record(stated, true).rollout(true, controlled=True, seconds=0.5)
    assert found.horizon_s == 0.5
    assert found.rms_after["shoulder"] < 0.05 * found.rms_before["shoulder"]


@pytest.mark.whole
def test_a_diagnosis_says_how_far_the_motion_of_both_models_strays(pendulum, record):
    made = record(pendulum, cause("coulomb_friction", "pin", 1.0))
    rollout = diagnose(pendulum, (made.recording,)).rollout
    assert rollout is not None
    assert set(rollout) == {"horizon_s", "rms_before", "rms_after", "reading_noise"}
    # The readings have noise of 0.01 mrad, and a little of it is left in what is smoothed.
    assert rollout["reading_noise"]["pin"] == pytest.approx(1e-5, rel=0.2)
    assert rollout["rms_after"]["pin"] < 0.2 * rollout["rms_before"]["pin"]


@pytest.mark.whole
def test_a_joint_that_a_brake_holds_does_not_stray(planar, rng):
    # Known truth: nothing is wrong. The elbow is held at 0.6 rad by a brake, and its drive gives no torque.
    t = np.arange(3000) / 250.0
    q, v, a = np.zeros((3, len(t), 2))
    q[:, 1] = 0.6
    for hz, phase in ((0.3, 0.0), (0.8, 1.0)):
        w = 2.0 * np.pi * hz
        q[:, 0] += 0.3 * np.sin(w * t + phase)
        v[:, 0] += 0.3 * w * np.cos(w * t + phase)
        a[:, 0] -= 0.3 * w**2 * np.sin(w * t + phase)
    tau = inverse_dynamics(planar, Motion(t, q, v, a))
    tau[:, 0] += 0.01 * rng.standard_normal(len(t))
    tau[:, 1] = 0.0
    readings = q + 1e-5 * rng.standard_normal(q.shape)
    found = diagnose(planar, (Recording("braked.csv", planar.joint_names, t, readings, tau),))
    assert found.verdict == "no_gap"
    assert found.rollout is not None
    assert "strays" not in found.rollout


def test_a_load_is_simulated_with_the_inertia_that_its_fit_has_seen(pendulum):
    # Oracle: the regressor of Pinocchio. Mass and moments alone would say another inertia, h^2/m = 0.5 kg m^2.
    seen = np.array([0.5, 0.0, 0.0, -0.5, 0.3, 0.0, 0.3, 0.0, 0.0, 0.0])
    term = Term(effect_named("payload"), None, (), tuple(range(3, 13)), 4, (-np.inf,) * 10, (np.inf,) * 10)
    robot = with_load(pendulum, (term,), np.concatenate([np.full(3, 7.0), seen]), 0)
    motion = Motion(np.zeros(1), np.array([[0.4]]), np.array([[1.0]]), np.array([[2.0]]))
    more = inverse_dynamics(robot, motion) - inverse_dynamics(pendulum, motion)
    wanted = rigid_body_regressor(pendulum, motion)[0] @ seen
    np.testing.assert_allclose(more[0], wanted, atol=1e-9)


def test_where_a_joint_stands_the_noise_of_other_times_stands_in():
    # By hand: two used samples, repeated over the three that are not.
    out = _without_gaps(np.array([9.0, 1.0, 9.0, 2.0, 9.0]), np.array([False, True, False, True, False]))
    np.testing.assert_array_equal(out, [1.0, 1.0, 2.0, 2.0, 1.0])
    np.testing.assert_array_equal(_without_gaps(np.ones(3), np.zeros(3, dtype=bool)), np.zeros(3))


def test_limits_of_several_joints_are_reported_in_one_sentence(planar2):
    past = [
        EngagedLimit("corrected", joint, "a.csv", 1.0, limit, windows, 20)
        for joint, limit, windows in (("shoulder", 2.0, 4), ("elbow", -1.5, 16))
    ]
    (said,) = sentences(limit_notes(planar2, tuple(past)))
    assert said.startswith(
        "a.csv: in 20 simulated windows joints run past limits of the corrected model that the recording comes up "
        "to and keeps "
        "(shoulder past 2 rad in 4, elbow past -1.5 rad in 16): "
    )


@pytest.fixture(scope="module")
def over(record, planar):
    """How far each joint of the planar arm strays over the band, with a cause and with noise of the torque [N m]."""
    made = record(planar)
    t, tau = made.log.motion.t, made.log.tau

    def of(size: float, noise: float, braked: tuple[int, ...] = ()) -> np.ndarray:
        causes = (Cause(effect_named("torque_offset"), "shoulder", np.array([size])),) if size else ()
        model = model_of(planar, causes)
        shots = tuple(replace(shot, window=replace(shot.window, fold=k % 4)) for k, shot in enumerate(made.shots()))
        wave = noise * np.sin(2.0 * np.pi * np.outer(t, [0.31, 0.37]))
        free = model_of(planar, ())
        return motion_deviations(
            shots,
            lambda window, fold: model if not braked or any(shots[k].window is window for k in braked) else free,
            lambda shot, known: exerted_torque(known, t, tau),
            (wave,),
            (0, 1, 2, 3),
            0.5,
            tuple(np.array([float(k in braked), 0.0]) for k in range(len(shots))),
        )

    return of


def test_the_right_model_strays_no_further_than_noise_makes_it(over):
    assert over(0.0, 0.02).max() < 1.0


def test_a_constant_torque_that_counts_as_no_noise_makes_a_joint_stray(over):
    assert over(1.0, 0.02)[0] > 1.0


def test_windows_in_which_a_joint_stands_and_yet_strays_say_nothing(over):
    # Known truth: a torque that the drive does not give acts on the shoulder in two windows, where it stands.
    assert over(30.0, 0.02, (0, 1)).max() < 1.0


def test_the_more_torque_counts_as_noise_the_less_is_beyond_it(over):
    # Closed form: where noise of the torque is all there is, the band grows with it.
    assert over(1.0, 4.0)[0] == pytest.approx(over(1.0, 2.0)[0] / 2.0, rel=0.1)


def test_a_model_whose_torque_shows_no_gap_but_which_strays_is_off_by_something_unknown(made_up):
    left = Unexplained(0.0, False, None, None)
    judgement = Judgement("no_gap", (), (), (), left, (), (), made_up().evidence)
    message = unknown_if_motion_deviates(judgement, Rollout(0.5, {}, {}, deviations={"j1": 1.2, "j2": 2.1}))
    assert (message.verdict, message.unexplained.joint) == ("unknown", "j2")
    assert unknown_if_motion_deviates(judgement, Rollout(0.5, {}, {})) == judgement
    assert unknown_if_motion_deviates(judgement, Rollout(0.5, {}, {}, deviations={"j2": 1.9})) == judgement
    explained = replace(judgement, verdict="explained")
    assert unknown_if_motion_deviates(explained, Rollout(0.5, {}, {}, deviations={"j1": 2.2})) == explained


CART = """<robot name="cart"><link name="base"/><link name="slide"><inertial><mass value="12"/>
<inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/></inertial></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="200" velocity="20"/><dynamics damping="30" friction="15"/></joint></robot>
"""


def test_friction_that_turns_between_two_rows_makes_no_motion_stray(tmp_path, rng):
    # Known truth: the model is exact. It turns about five times a second, somewhere between rows 40 ms apart.
    (tmp_path / "cart.urdf").write_text(CART)
    cart = load_robot(tmp_path / "cart.urdf")
    t, w = np.arange(0.0, 60.0, 0.04), 2.0 * np.pi * np.array([0.31, 0.83, 1.37])
    size, waves = np.array([0.1, 0.05, 0.03]), np.outer(t, w) + rng.uniform(0.0, 6.28, 3)
    q, v, a = (
        x.sum(axis=1)[:, None] for x in (size * np.sin(waves), size * w * np.cos(waves), -size * w**2 * np.sin(waves))
    )
    tau = inverse_dynamics(cart, Motion(t, q, v, a)) + 0.05 * rng.standard_normal(q.shape)
    found = diagnose(cart, (Recording("log.csv", ("x",), t, q + 2e-6 * rng.standard_normal(q.shape), tau),))
    assert found.verdict == "no_gap"


def test_the_torque_of_a_turn_has_the_impulse_that_rows_do_not_show(tmp_path, rng):
    # Oracle: drawn instants of a jump from -15 to 15 N between two rows, against the straight line between them.
    (tmp_path / "cart.urdf").write_text(CART)
    cart, dt = load_robot(tmp_path / "cart.urdf"), 0.04
    jumps = rng.uniform(0.0, dt, 100_000)
    missed = 15.0 * (dt - jumps) - 15.0 * jumps
    torque = turning_torque(cart, np.array([[1.0], [0.2], [-0.2], [-1.0]]))
    assert dt * torque[:, 0] == pytest.approx([0.0, missed.std(), 0.0, 0.0], rel=0.01)
    assert not turning_torque(replace(cart, torque_hold="zoh"), np.array([[1.0], [-1.0]])).any()


def evidence(samples: int) -> Evidence:
    none = np.zeros((samples, 1))
    return Evidence(np.arange(float(samples)), none, none, none, none, none, none, ({},))


def log() -> Log:
    """A second at 100 Hz, of which every fifth sample is drawn."""
    t, none = np.arange(101) / 100.0, np.zeros((101, 1))
    band = Band(100.0, 10.0, np.ones(1), 5)
    return Log("a.csv", ("j",), Motion(t, none, none, none), none, band, np.ones(101, dtype=bool))


def test_each_window_stands_at_its_own_samples_but_for_its_first():
    logs, read = (log(), log()), np.arange(50.0)[:, None]
    motions = (WindowMotion(Window(1, 20, 70, 0, 0), read, -read),)
    found = with_simulated_motion(evidence(42), Rollout(0.1, {}, {}, motions=motions, controlled=True), logs).simulated
    assert found is not None
    assert (round(found.seconds, 9), found.controlled) == (0.49, True)
    expected = np.full(42, np.nan)
    expected[21 + np.arange(5, 14)] = 5.0 * np.arange(1, 10)
    np.testing.assert_array_equal(found.before[:, 0], expected)
    np.testing.assert_array_equal(found.after[:, 0], -expected)


def test_nothing_simulated_changes_nothing():
    given = evidence(21)
    assert with_simulated_motion(given, Rollout(None, {}, {}), (log(),)) is given
