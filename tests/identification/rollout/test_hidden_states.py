"""Rollouts with hidden states, and unlike recordings.

Rollouts of legs that swing on a base that moves as it was measured.

Oracles: known truth, on torques that Pinocchio computes for a free-flyer; and by hand.
"""

from dataclasses import replace

import numpy as np
import pytest

from floating_leg import log_of_leg, written_leg
from identification.data.changes import Change, KnownPayload, robot_in
from identification.data.floating.base_errors import base_without_errors, torque_of_base_errors
from identification.data.log import Band, Log
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from identification.diagnosis.evidence import Evidence
from identification.engine.products.blocks import Block
from identification.notes import Code
from identification.pipeline import diagnose
from identification.rollout.compare import Errors, Rollout, WindowMotion
from identification.rollout.rollout_starts import Window, exerted_torque, spread, true_state, windows_in
from identification.rollout.shots import has_hidden_states, under_torque
from identification.rollout.simulated_models import model_of
from identification.rollout.simulated_motion import with_simulated_motion
from identification.words.note_words import sentence
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator, Controller, Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import position_control, torque_over_time
from phantom_dyn.simulation.simulate import Cause, Given, simulate

PLAY = Cause(effect_named("backlash"), "elbow", np.array([0.03]))

SPRING = Cause(effect_named("transmission_compliance"), "elbow", np.array([150.0]))


def seen_on(robot: Robot, side: str) -> Robot:
    return replace(robot, actuators=tuple(replace(one, encoder_side=side) for one in robot.actuators))


@pytest.fixture(scope="module")
def in_play(planar, record):
    """A recording of an elbow with 0.03 rad of play, read on the motor."""
    return record(planar, PLAY)


@pytest.fixture(scope="module")
def behind_link(planar, record):
    """The same with the encoder on the link, under a controller that this does not upset."""
    return record(seen_on(planar, "link"), PLAY, kp=40.0, kd=4.0)


@pytest.fixture(scope="module")
def sprung(planar, record):
    """An elbow on a spring with the encoder on the link."""
    return record(seen_on(planar, "link"), SPRING, kp=10.0, kd=1.0)


def rms(errors: list[np.ndarray]) -> np.ndarray:
    return np.sqrt(np.mean(np.square(np.concatenate(errors)), axis=0))


def strayed(made, true: Cause, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the true model from estimated states, and from the states of the truth, on windows of such length."""
    model, ours, best = model_of(made.robot, (true,)), [], []
    torque = exerted_torque(model, made.log.motion.t, made.log.tau)
    for shot in made.shots(seconds):
        k, rows = shot.window.start, slice(shot.window.start, shot.window.stop)
        ours.append((under_torque(shot, model, torque) - shot.read)[1:])
        law, truth = torque_over_time(made.log.motion.t[rows], torque[rows]), made.truth
        motors = (
            (truth.encoders.q[k], truth.encoders.v[k]) if model.robot.actuators[1].encoder_side == "motor" else None
        )
        start = truth.links.q[k], truth.links.v[k]
        simulation = simulate(model.torque_driven, (true,), law, law.t, *start, max_step=1e-3, given=Given(motors))
        best.append((simulation.q - shot.read)[1:])
    return rms(ours), rms(best)


def test_from_estimated_states_the_true_model_strays_as_little_as_from_true_ones(in_play):
    ours, best = strayed(in_play, PLAY, 0.5)
    assert (ours < 2.0 * best).all()


def test_a_link_in_its_play_is_found(in_play):
    model = model_of(in_play.robot, (PLAY,))
    torque = exerted_torque(model, in_play.log.motion.t, in_play.log.tau)
    errors = []
    for shot in in_play.shots():
        hidden = shot.with_hidden_start(model, torque).hidden_start
        errors.append(abs(hidden.start.q - in_play.truth.links.q[hidden.at])[1])
    # Of 15 mrad to either side.
    assert np.median(errors) < 1e-3


@pytest.mark.parametrize(("name", "true", "most"), [("behind_link", PLAY, 6e-4), ("sprung", SPRING, 2e-4)])
def test_a_motor_that_the_encoder_does_not_see_is_found(request, name, true, most):
    ours, _ = strayed(request.getfixturevalue(name), true, 0.1)
    assert ours[1] < most


@pytest.mark.parametrize(
    ("name", "true", "share"), [("in_play", PLAY, 0.55), ("behind_link", PLAY, 0.34), ("sprung", SPRING, 0.1)]
)
def test_what_was_found_lessens_the_error(request, name, true, share):
    # Behind a play on the motor the torque between samples is what limits: true states leave as much.
    found = request.getfixturevalue(name).rollout(true)
    assert found.horizon_s == 0.5
    assert found.rms_after["elbow"] < share * found.rms_before["elbow"]


def test_under_its_controller_the_true_model_strays_by_the_noise(planar, record):
    # Oracle: the readings have noise of 0.01 mrad.
    stated = replace(planar, actuators=(Actuator(controller=Controller(kp=300.0, kd=30.0)),) * 2)
    found = record(stated, PLAY).rollout(PLAY, controlled=True)
    assert found.rms_after["elbow"] < 0.15 * found.rms_before["elbow"]
    assert found.rms_after["elbow"] < 3e-5


def test_a_motor_on_a_spring_starts_where_its_encoder_reads_it(planar, record):
    found = record(planar, SPRING).rollout(SPRING)
    assert found.rms_after["elbow"] < 0.2 * found.rms_before["elbow"]


def test_no_sample_behind_the_start_is_used(in_play):
    model = model_of(in_play.robot, (PLAY,))
    torque = exerted_torque(model, in_play.log.motion.t, in_play.log.tau)
    shot = in_play.shots()[5]
    raw, late = shot.states.raw.copy(), torque.copy()
    raw[shot.window.start + 1 :] += 1.0
    late[shot.window.start + 1 :] += 10.0
    other = replace(shot, states=replace(shot.states, raw=raw))
    ours, theirs = (
        shot.with_hidden_start(model, torque).hidden_start.start,
        other.with_hidden_start(model, late).hidden_start.start,
    )
    np.testing.assert_array_equal(ours.q, theirs.q)
    np.testing.assert_array_equal(ours.motor_v, theirs.motor_v)


def test_without_samples_before_a_window_the_smoothed_state_is_taken(in_play):
    model = model_of(in_play.robot, (PLAY,))
    torque = exerted_torque(model, in_play.log.motion.t, in_play.log.tau)
    shot = in_play.shots()[3]
    bare = replace(shot, window=replace(shot.window, lead=0))
    hidden = bare.with_hidden_start(model, torque).hidden_start
    assert hidden.at == shot.window.start
    np.testing.assert_array_equal(hidden.start.q, true_state(model, shot.states, hidden.at, 1 / 250.0).q)


def test_a_rigid_joint_and_a_spring_behind_its_motor_hide_nothing(planar):
    assert not has_hidden_states(model_of(planar, ()))
    assert not has_hidden_states(model_of(planar, (SPRING,)))
    assert has_hidden_states(model_of(planar, (PLAY,)))
    assert has_hidden_states(model_of(seen_on(planar, "link"), (SPRING,)))


RUBS = Cause(effect_named("coulomb_friction"), "pin", np.array([1.0]))


@pytest.fixture(scope="module")
def two_loads(pendulum, record):
    """Diagnosis of a pendulum that rubs, without and with 1.5 kg, under two controllers."""
    gains = ((300.0, 30.0), (120.0, 12.0))
    first, second = ({"pin": Controller("pd", *pair)} for pair in gains)
    changes = (
        Change("a.csv", controllers=first),
        Change("b.csv", KnownPayload(1.5, (0.0, 0.0, -0.9)), controllers=second),
    )
    robots = [robot_in(pendulum, change) for change in changes]
    recordings = tuple(
        replace(record(robot, RUBS, kp=kp, kd=kd).recording, file=change.file)
        for robot, (kp, kd), change in zip(robots, gains, changes, strict=True)
    )
    return diagnose(pendulum, recordings, changes=changes)


@pytest.mark.whole
def test_each_recording_is_simulated_with_the_load_that_it_carried(two_loads):
    # Without its 1.5 kg the second one would be 30 times as far off.
    apart = {entry["recording"]: entry for entry in two_loads.rollout["recordings"]}
    assert list(apart) == ["a.csv", "b.csv"]
    for entry in apart.values():
        assert entry["rms_after"]["pin"] < 2e-3
        assert entry["rms_after"]["pin"] < 0.2 * entry["rms_before"]["pin"]


@pytest.mark.whole
def test_the_error_of_all_is_the_mean_square_of_that_of_each(two_loads):
    whole = two_loads.rollout["rms_before"]["pin"]
    parts = [entry["rms_before"]["pin"] for entry in two_loads.rollout["recordings"]]
    assert min(parts) < whole < max(parts)


@pytest.mark.whole
def test_each_recording_is_simulated_under_its_own_controller(two_loads):
    (said,) = (sentence(note) for note in two_loads.notes if note.code is Code.CLOSED_LOOP)
    before, after = (float(said.split(" by ")[k].split()[0]) for k in (1, 2))
    assert after < 0.2 * before


@pytest.mark.whole
def test_one_recording_is_not_separated(pendulum, record):
    rollout = record(pendulum, RUBS).rollout(RUBS)
    assert "recordings" not in rollout.json


@pytest.mark.whole
def test_a_recording_that_runs_into_a_stop_of_the_model_says_where_and_when(pendulum, ready):
    # Truth: a stop at 0.5 rad, which the drive runs into where its reference goes to 0.7 rad.
    model = pendulum.model.copy()
    model.upperPositionLimit = np.array([0.5])
    robot = replace(pendulum, model=model)
    t = np.arange(2000) / 200.0
    q_ref = (0.1 + 0.6 * np.sin(2.4 * t) + 0.05 * np.sin(7.0 * t))[:, None]
    law = position_control(t, q_ref, np.gradient(q_ref, t, axis=0), kp=np.array([80.0]), kd=np.array([8.0]))

    def held(time, q, v):
        return law(time, q, v) - np.where(q > 0.5, 2e4 * (q - 0.5) + 200.0 * v, 0.0)

    moved = simulate(robot, (), held, t, q_ref[0])
    rng = np.random.default_rng(4)
    asked = np.array([law(*row) for row in zip(t, moved.q, moved.links.v, strict=True)])
    q = moved.q + 1e-5 * rng.standard_normal(q_ref.shape)
    tau = asked + 0.01 * rng.standard_normal(q_ref.shape)
    recording = Recording("stop.csv", robot.joint_names, t, q, tau)
    found = ready(robot, recording, moved).rollout()
    assert found.json is not None
    (one,) = (one for one in found.json["limits_engaged"] if one["model"] == "given")
    assert (one["joint"], one["recording"], one["limit"]) == ("pin", "stop.csv", 0.5)
    pressed = t[moved.q[:, 0] > 0.4999]
    assert np.abs(pressed - one["t"]).min() < 0.5
    assert "pin runs past the limit of 0.5 rad" in sentence(found.warnings[0])


DRY = Cause(effect_named("coulomb_friction"), "knee", np.array([0.3]))


@pytest.fixture(scope="module")
def stepping(tmp_path_factory, ready):
    """A leg with more friction at its knee than its model has, whose foot stands half of the time."""
    file = written_leg(tmp_path_factory.mktemp("leg"))
    robot = load_robot(file)
    columns = log_of_leg(file, np.random.default_rng(5), dry=0.3, steps=True)
    return ready(robot, recording(Table("log.csv", columns), robot), None)


def test_a_model_with_its_friction_follows_the_swings_and_the_given_one_does_not(stepping):
    found = stepping.rollout(DRY)
    assert found.rms_after["knee"] < 0.1 * found.rms_before["knee"]
    assert found.rms_after["knee"] < 0.01


def test_a_base_that_were_bolted_down_would_take_the_leg_elsewhere(stepping):
    on_base = stepping.rollout(DRY)
    log = stepping.log
    level = replace(
        log.motion.base,
        w=0 * log.motion.base.w,
        dw=0 * log.motion.base.dw,
        f=np.tile([0.0, 0.0, 9.81], (len(log.tau), 1)),
    )
    held = replace(stepping, log=replace(log, motion=replace(log.motion, base=level))).rollout(DRY)
    assert held.rms_after["knee"] > 10 * on_base.rms_after["knee"]


def test_nothing_is_compared_while_the_foot_stands(stepping):
    shots = stepping.shots()
    assert len(shots) > 3
    assert not any(shot.log.touched[shot.window.start : shot.window.stop].any() for shot in shots)


def test_a_leg_is_led_along_the_recording_while_its_foot_stands(stepping):
    # Some 20 N m of the ground are in the measured torque.
    log, model = stepping.log, model_of(stepping.robot, ())
    first = int(np.flatnonzero(log.touched[1:, 0] & ~log.touched[:-1, 0])[3]) + 1
    shot = replace(stepping.shots()[0], window=Window(0, first, first + 250, -1, 0))
    off = [
        np.abs(under_torque(one, model, log.tau) - shot.read).max()
        for one in (shot, replace(shot, log=replace(log, touched=None)))
    ]
    assert log.touched[first : first + 250].all()
    assert off[0] < 0.3 < 10.0 < off[1]


def test_stiff_controllers_hold_both_models_near_their_references(stepping):
    actuators = tuple(replace(a, controller=Controller(kp=100.0, kd=1.0)) for a in stepping.robot.actuators)
    log = replace(stepping.log, q_ref=stepping.log.motion.q)
    stiff = replace(stepping, robot=replace(stepping.robot, actuators=actuators), log=log)
    found = stiff.rollout(controlled=True)
    assert max(found.rms_after.values()) < 0.05


def test_without_the_errors_of_its_sensors_the_base_needs_their_spurious_torque_less(stepping):
    robot, log = stepping.robot, stepping.log
    sizes = (("accelerometer offset x", 2e-4), ("gyroscope scale y", 1e-5), ("place of the accelerometer z", 1e-5))
    base = base_without_errors(robot, log, slice(None), sizes)
    more = inverse_dynamics(robot, replace(log.motion, base=base)) - inverse_dynamics(robot, log.motion)
    np.testing.assert_allclose(more, torque_of_base_errors(robot, log, sizes), rtol=0, atol=1e-9)


def legs(*touched: np.ndarray) -> Log:
    """A second at 100 Hz of legs of one joint each."""
    t, none = np.arange(100) / 100.0, np.zeros((100, len(touched)))
    names = tuple(f"j{k}" for k in range(len(touched)))
    band = Band(100.0, 10.0, np.ones(1), 1)
    log = Log("a.csv", names, Motion(t, none, none, none), none, band, np.ones(100, dtype=bool))
    return replace(log, touched=np.column_stack(touched))


def at(*stretches: tuple[int, int]) -> np.ndarray:
    out = np.zeros(100, dtype=bool)
    for start, stop in stretches:
        out[start:stop] = True
    return out


def windows(log: Log, seconds: float = 0.5) -> list[tuple[tuple[int, ...] | None, int, int, int]]:
    blocks, one = (Block(0, 0, 100, 0),), np.zeros(1, np.int64)
    found = windows_in((log,), blocks, one, one, seconds=seconds, lead=0.2)
    return sorted((w.joints, w.start, w.stop, w.lead) for w in found)


def test_every_leg_has_windows_in_its_own_swings():
    left, right = at((0, 40), (70, 100)), at((30, 80))
    assert windows(legs(left, left, right)) == [((0, 1), 40, 70, 0), ((2,), 0, 30, 0), ((2,), 80, 100, 0)]


def test_long_swings_are_cut_and_what_was_free_before_leads_up_to_a_window():
    assert windows(legs(at((0, 20))), seconds=0.39) == [((0,), 20, 60, 0), ((0,), 60, 100, 20)]


def test_a_contact_that_flickers_leaves_no_swing():
    flickers = at((0, 30), (37, 60))
    assert windows(legs(flickers)) == [((0,), 60, 100, 0)]


def test_a_robot_that_hangs_has_windows_of_all_its_joints():
    assert windows(legs(at(), at()), seconds=0.49) == [(None, 0, 50, 0), (None, 50, 100, 20)]


def test_every_leg_has_as_many_windows():
    many = tuple(Window(0, k, k + 1, 0, 0, (leg,)) for leg in range(4) for k in range(20 + leg))
    chosen = spread(many, 12)
    assert [w.joints for w in chosen] == [(leg,) for leg in range(4) for _ in range(3)]
    assert [w.start for w in chosen[:3]] == [0, 10, 19] or [w.start for w in chosen[:3]] == [0, 9, 19]


def test_errors_are_those_of_the_joints_that_a_window_compares():
    # By hand: 3 and 4 in windows of the first joint, 5 of the second, none of the third.
    none = np.full(2, np.nan)
    series = (np.column_stack([[0.0, 3.0], none, none]), np.column_stack([[0.0, 4.0], none, none]),
              np.column_stack([none, [0.0, 5.0], none]))  # fmt: skip
    errors = Errors(3 * (np.array([0.0, 1.0]),), *(4 * (series,)))
    np.testing.assert_allclose(errors.rms(series, 1.0), [np.sqrt(12.5), 5.0, 0.0])
    np.testing.assert_array_equal(errors.is_compared, [True, True, False])


def test_swings_of_two_legs_at_once_are_both_drawn():
    log, none = legs(at(), at()), np.zeros((100, 2))
    evidence = Evidence(log.motion.t, none, none, none, none, none, none, ({}, {}))
    one, other = np.full((50, 2), np.nan), np.full((50, 2), np.nan)
    one[:, 0], other[:, 1] = 1.0, 2.0
    motions = (
        WindowMotion(Window(0, 20, 70, 0, 0, (0,)), one, one),
        WindowMotion(Window(0, 30, 80, 0, 0, (1,)), other, other),
    )
    followed = with_simulated_motion(evidence, Rollout(0.5, {}, {}, motions=motions), (log,)).simulated
    assert np.flatnonzero(followed.before[:, 0] == 1.0).tolist() == list(range(21, 70))
    assert np.flatnonzero(followed.after[:, 1] == 2.0).tolist() == list(range(31, 80))
