"""What is expected of each sample of each log, and the events that chance leaves. Oracle: by hand, SciPy's filters."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.diagnosis.judge.bursts import _events_in, bursts_in, bursts_of, rounding_torque
from identification.engine.products.blocks import Block

PLACE = "identification.diagnosis.judge.bursts."


@pytest.fixture
def twice(quiet):
    """The problem of the same recording twice, the second time in another file and with other blocks."""
    columns, session = quiet.columns, quiet.session
    names = ("values", "residual", "model_torque", "usable", "reversal_std", "standstill_std", "operations")
    columns = replace(columns, **{name: 2 * getattr(columns, name) for name in names})
    blocks = (Block(0, 0, 100, 0), Block(0, 100, 300, 100), Block(1, 0, 200, 0))
    logs = (session.logs[0], replace(session.logs[0], file="other.csv"))
    session = replace(session, logs=logs, blocks=blocks, folds=np.array([3, 4, 5]))
    return replace(quiet.problem, session=session, columns=columns)


@pytest.fixture
def asked(monkeypatch):
    """Arguments of what is called for each joint and each log; nothing is found."""
    seen = {"expected": [], "found": []}

    def expected(residual, causes, use, fold):
        seen["expected"].append((residual, causes, use, fold))
        return np.full(len(residual), 0.25)

    def found(t, left, size, usable, joints):
        seen["found"].append((t, left, size, usable, joints))
        return ()

    monkeypatch.setattr(PLACE + "expected_error", expected)
    monkeypatch.setattr(PLACE + "bursts_in", found)
    monkeypatch.setattr(PLACE + "moving_torque", lambda torque, rate, cutoff: (torque, rate, cutoff))
    return seen


def still(problem) -> tuple[np.ndarray, ...]:
    """No doubt about friction at any time."""
    return tuple(np.zeros_like(part) for part in problem.columns.residual)


def test_each_joint_of_each_log_is_judged_by_its_own_blocks_and_torque(twice, asked):
    residual = tuple(k + np.arange(2.0) + np.zeros_like(part) for k, part in enumerate(twice.columns.residual))
    assert bursts_of(twice, residual, still(twice)) == ()
    count = len(residual[0])
    folds = [np.repeat([3, 4, 0], [100, 200, count - 300]), np.repeat([5, 0], [200, count - 200])]
    for (left, causes, _, fold), (log, j) in zip(asked["expected"], ((0, 0), (0, 1), (1, 0), (1, 1)), strict=True):
        np.testing.assert_array_equal(left, float(log + j))
        np.testing.assert_array_equal(fold, folds[log])
        torque, rate, cutoff_hz = causes.torque
        np.testing.assert_array_equal(torque, twice.columns.model_torque[log][:, j])
        # By hand: every sixth sample of 200 Hz.
        assert rate == pytest.approx(200.0 / 6.0)
        assert cutoff_hz == twice.session.cutoff_hz


def test_the_variance_of_friction_that_is_in_doubt_is_known_beforehand(twice, asked):
    doubt = tuple(
        size * np.ones_like(part) for size, part in zip((25.0, 34.0), twice.columns.reversal_std, strict=True)
    )
    bursts_of(twice, twice.columns.residual, doubt)
    known = [float(np.unique(causes.known).item()) for _, causes, _, _ in asked["expected"]]
    assert known == [25.0, 25.0, 34.0, 34.0]


def test_a_push_from_outside_is_what_the_drive_lacks_inside_one_period_of_the_edge(twice, asked):
    residual = tuple(np.random.default_rng(k).normal(size=part.shape) for k, part in enumerate(twice.columns.residual))
    use = np.random.default_rng(2).random(residual[0].shape) < 0.9
    problem = replace(twice, columns=replace(twice.columns, usable=(use, ~use)))
    bursts_of(problem, residual, still(problem))
    log = problem.session.logs[0]
    t = log.motion.t[log.samples]
    period = 1.0 / problem.session.cutoff_hz
    inside = (t - t[0] > period) & (t[-1] - t > period)
    for k, (times, left, expected, usable, joints) in enumerate(asked["found"]):
        np.testing.assert_array_equal(times, t)
        np.testing.assert_array_equal(left, -residual[k])
        np.testing.assert_array_equal(expected, 0.25)
        np.testing.assert_array_equal(usable, problem.columns.usable[k] & inside[:, None])
        assert joints == log.joint_names
    assert 0 < (~inside).sum() < 0.2 * len(t)


def test_beside_a_hole_nothing_is_looked_for_within_one_period_of_the_edge(twice, asked):
    log = twice.session.logs[0]
    t, valid = log.motion.t, np.ones(len(log.motion.t), dtype=bool)
    valid[len(t) // 2] = False
    holed = replace(log, valid=valid)
    problem = replace(twice, session=replace(twice.session, logs=(holed, holed)))
    bursts_of(problem, twice.columns.residual, still(twice))
    at, period = t[log.samples], 1.0 / problem.session.cutoff_hz
    outside = np.flatnonzero(~holed.valid_in_band)
    before, behind = at[outside[0] - 1], at[outside[-1] + 1]
    inside = (at > at[0] + period) & (at < before - period) | (at > behind + period) & (at < at[-1] - period)
    for _, _, _, usable, _ in asked["found"]:
        np.testing.assert_array_equal(usable.any(axis=1), inside)


def test_a_joint_without_usable_samples_is_expected_to_be_anything(twice, asked):
    use = np.ones_like(twice.columns.usable[0])
    use[:, 1] = False
    problem = replace(twice, columns=replace(twice.columns, usable=(use, use)))
    bursts_of(problem, twice.columns.residual, still(problem))
    for _, _, expected, _, _ in asked["found"]:
        assert np.isinf(expected[:, 1]).all()
        assert np.isfinite(expected[:, 0]).all()


def test_a_burst_is_more_than_a_thousandth_of_the_torque_of_its_joint(twice, monkeypatch):
    # By hand: torques of 300 and 400 of the model and as much again that it leaves, so that 0.6 and 0.8 are too little.
    events = tuple(
        (joint, 1.0, 2.0, torque, 9.0)
        for joint, torque in (("shoulder", 0.59), ("shoulder", -0.61), ("elbow", -0.79), ("elbow", 0.81))
    )
    monkeypatch.setattr(PLACE + "bursts_in", lambda *_: events)
    size = tuple(np.array([300.0, -400.0]) * np.ones_like(part) for part in twice.columns.residual)
    problem = replace(twice, columns=replace(twice.columns, model_torque=size, residual=size))
    found = bursts_of(problem, twice.columns.residual, still(problem))
    said = [(burst.file, burst.joint, burst.start, burst.stop, burst.torque, burst.ratio) for burst in found]
    files = [log.file for log in problem.session.logs]
    assert said == [(file, *events[k]) for file in files for k in (1, 3)]


def jumps(*pushes: tuple[int, int, float], count: int = 600) -> np.ndarray:
    """Sizes relative to what is expected: pushes from a sample up to another one, and nothing else."""
    out = np.zeros(count)
    for first, stop, size in pushes:
        out[first:stop] = size
    return out


def test_an_event_lasts_as_long_as_it_is_above_a_quarter_of_its_level():
    # By hand: at 20 Hz the shortest window has three samples of weights 1/2, 1, 1/2, so that a sample before and behind
    # a push of 40 has a level of 10, which is a quarter and no more.
    relative = jumps((100, 130, 40.0))
    relative[99], relative[130] = 0.1, -0.1
    ((first, last, ratio),) = _events_in(relative, np.ones(600, dtype=bool), 0.05, 1)
    assert (first, last) == (99, 129)
    # The mean over a second of the push is the push.
    assert ratio == pytest.approx(40.0)


@pytest.mark.parametrize(("gap", "found"), [(3, False), (4, True)])
def test_an_event_takes_as_much_with_it_on_either_side_as_the_shortest_one_lasts(gap, found):
    # By hand: at 20 Hz three samples of 0.15 s on either side of samples 100 to 129.
    for other in (100 - gap, 129 + gap):
        relative = jumps((100, 130, 400.0), (other, other + 1, -200.0))
        use = np.ones(600, dtype=bool)
        use[min(other, 129) + 1 : max(other, 100)] = False
        events = _events_in(relative, use, 0.05, 1)
        assert events[0][:2] == (100, 129)
        assert any(first <= other <= last for first, last, _ in events[1:]) is found


@pytest.mark.parametrize(("elsewhere", "found"), [(0.0, 2), (4.9, 2), (5.1, 1), (-5.9, 1)])
def test_an_event_is_twice_as_large_as_what_is_no_event(elsewhere, found):
    # By hand: events are six times what is expected; of 10 and 30, only the latter is twice as large as 5.1.
    relative = jumps((100, 130, 10.0), (250, 280, -30.0), (400, 430, elsewhere))
    events = _events_in(relative, np.ones(600, dtype=bool), 0.05, 1)
    assert sorted(ratio for *_, ratio in events) == pytest.approx([10.0, 30.0][2 - found :])


def test_what_encoders_feign_is_no_event(twice, monkeypatch):
    events = tuple(("elbow", 1.0, 2.0, torque, 9.0) for torque in (0.49, -0.51))
    monkeypatch.setattr(PLACE + "bursts_in", lambda *_: events)
    monkeypatch.setattr(PLACE + "rounding_torque", lambda robot, log, row, start, stop: 0.5 if row == 1 else 9.0)
    torques = [burst.torque for burst in bursts_of(twice, twice.columns.residual, still(twice))]
    assert torques == [-0.51, -0.51]


def test_what_a_controller_answers_above_the_band_is_no_event_in_it(twice, monkeypatch):
    # By hand: twice the root of a mean square of 0.0625 is 0.5.
    events = tuple(("elbow", 1.0, 2.0, torque, 9.0) for torque in (0.49, -0.51))
    monkeypatch.setattr(PLACE + "bursts_in", lambda *_: events)
    monkeypatch.setattr(PLACE + "torque_above_band", lambda problem, sensors: np.array([9.0, 0.0625]))
    torques = [burst.torque for burst in bursts_of(twice, twice.columns.residual, still(twice))]
    assert torques == [-0.51, -0.51]


@pytest.mark.parametrize("seconds", [0.05, 0.15, 0.4])
def test_no_error_of_half_a_step_makes_more_than_rounding_may(planar2, quiet, seconds):
    # Brute force: the worst error has the sign of the second derivative of the window over at least 0.15 s, here of the
    # elbow's encoder alone, whose inertia as the shoulder feels it is Pinocchio's.
    log, length, step = quiet.session.logs[0], max(seconds, 0.15), 2e-3
    log = replace(log, reading_steps=(0.0, step))
    at = int(np.searchsorted(log.motion.t, 3.0))
    t = np.linspace(-0.5, 0.5, 200_001) * length
    window = (1.0 + np.cos(2.0 * np.pi * t / length)) / length
    bent = np.gradient(np.gradient(window, t), t)
    worst = float(np.sum(bent * 0.5 * step * np.sign(bent)) * (t[1] - t[0]))
    inertia = pin.crba(planar2.model, planar2.model.createData(), log.motion.q[at])
    for row in (0, 1):
        said = rounding_torque(planar2, log, row, 3.0, 3.0 + seconds)
        assert said == pytest.approx(abs(inertia[row, 1]) * worst, rel=1e-3)


@pytest.mark.parametrize(("samples", "found"), [(49, 0), (50, 1)])
def test_fifty_usable_samples_are_looked_at(samples, found):
    t = 0.05 * np.arange(200)
    use = (np.arange(200) < samples)[:, None]
    left = jumps((20, 24, 5.0), count=200)[:, None]
    assert len(bursts_in(t, left, np.full((200, 1), 0.05), use, ("j1",))) == found


def test_the_torque_of_a_burst_is_its_largest_about_the_median_of_usable_samples():
    # By hand: an offset of two, a push of five that peaks at minus nine, and a sample that may not be used.
    t = 0.05 * np.arange(600)
    left = 2.0 - jumps((300, 310, 5.0), (305, 306, 9.0))
    use = np.ones(600, dtype=bool)
    use[:200], left[:200] = False, 77.0
    ((joint, start, stop, torque, _),) = bursts_in(t, left[:, None], np.full((600, 1), 0.05), use[:, None], ("j1",))
    assert (joint, torque) == ("j1", pytest.approx(-9.0))
    assert (start, stop) == (t[300], t[309])


@pytest.mark.parametrize(("share", "found"), [(0.14, 1), (0.16, 2)])
def test_a_burst_of_less_than_a_seventh_of_the_largest_is_its_echo(share, found):
    # By hand: 15 %, each way.
    for sides in ((1.0, -1.0), (-1.0, 1.0)):
        left = jumps((100, 110, 5.0 * sides[0]), (400, 410, 5.0 * share * sides[1]))[:, None]
        assert len(bursts_in(0.05 * np.arange(600), left, np.full((600, 1), 0.01), left < 99, ("j1",))) == found


@pytest.mark.parametrize(("gap", "found"), [(0, 1), (2, 2)])
def test_bursts_of_two_joints_that_are_more_than_a_tenth_of_a_second_apart_are_two(gap, found):
    # By hand: at 20 Hz the one ends a sample before the other begins, or three.
    for order in (1, -1):
        left = np.column_stack([jumps((100, 110, 5.0)), jumps((110 + gap, 120 + gap, 4.0))][::order])
        expected = np.full((600, 2), 0.05)
        assert len(bursts_in(0.05 * np.arange(600), left, expected, left < 99, ("a", "b"))) == found
