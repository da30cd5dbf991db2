"""Constant, offset and saturation of a drive's torque, and its rotor."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.drive.rotor_inertia import RotorInertia
from phantom_dyn.effects.drive.torque_constant import TorqueConstant
from phantom_dyn.effects.drive.torque_offset import TorqueOffset
from phantom_dyn.effects.drive.torque_saturation import TorqueSaturation, _is_flat, _plateau, _plausible, largest_given
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion

EFFECT = TorqueSaturation()


@pytest.fixture(scope="module")
def saturated(arm, smooth) -> Operation:
    """The command of ``tilt`` is a sine of 4 N m that lasts 2 s; what the drive gives of it is not looked at here."""
    logged = smooth.tau.copy()
    logged[:, 1] = 4.0 * np.sin(np.pi * smooth.t)
    return Operation.of(arm, smooth, logged)


def test_the_true_torque_is_the_command_within_the_limit(arm, saturated):
    # Contract: clip at +-limit; the torque is the clipped command less the command.
    true = saturated.logged + EFFECT.torque(arm, saturated, "tilt", np.array([2.5]))
    np.testing.assert_allclose(true[:, 1], np.clip(saturated.logged[:, 1], -2.5, 2.5), atol=4e-3)
    np.testing.assert_array_equal(true[:, [0, 2]], saturated.logged[:, [0, 2]])


def test_the_drive_is_asked_for_the_excess_with_coefficient_one(arm, saturated):
    driven = replace(saturated, expected=np.clip(saturated.logged, -3.3, 3.3))
    columns = EFFECT.signature(arm, driven, "tilt", (3.3,)).columns
    torque = EFFECT.torque(arm, saturated, "tilt", np.array([3.3]))
    np.testing.assert_array_equal(torque[:, 1], -columns[:, 0, 0])
    assert EFFECT.from_coefficients(arm, "tilt", np.array([0.97]), (3.3,)) == pytest.approx([3.3])


@pytest.mark.parametrize("share", [0.3, 1.8])
def test_a_limit_that_the_motion_speaks_against_leaves_nothing(arm, saturated, share):
    # At its limit a drive gives just the limit, so the model needs neither a third of it nor twice as much.
    driven = replace(saturated, expected=share * np.clip(saturated.logged, -3.3, 3.3))
    assert not EFFECT.signature(arm, driven, "tilt", (3.3,)).columns.any()


def test_a_limit_that_the_command_exceeds_most_of_the_time_is_one_if_the_motion_needs_just_it(arm, saturated):
    # Closed form: a sine of amplitude 4 is beyond 0.5 for 92 % of the time.
    driven = replace(saturated, expected=np.clip(saturated.logged, -0.5, 0.5))
    assert EFFECT.signature(arm, driven, "tilt", (0.5,)).columns.any()


@pytest.mark.parametrize(("limit", "believed"), [(0.33, True), (0.29, False)])
def test_a_limit_that_the_command_hardly_ever_keeps_is_none(arm, saturated, limit, believed):
    # Closed form: a sine of amplitude 4 is beyond 0.314 for 95 % of the time. A model that lacks its load needs little
    # torque, whatever is commanded.
    driven = replace(saturated, expected=np.clip(saturated.logged, -limit, limit))
    assert EFFECT.signature(arm, driven, "tilt", (limit,)).columns.any() == believed


def test_friction_that_the_model_lacks_is_no_limit_though_it_is_beyond_one_most_of_the_time(arm, saturated):
    # The model needs 0.5 N m of friction and a little inertia, the robot 1 N m: a constant beyond a constant.
    direction = np.sign(saturated.logged)
    inertia = 0.1 * np.cos(3.0 * saturated.t)[:, None]
    rubbed = replace(saturated, logged=direction + inertia, expected=0.5 * direction + inertia)
    assert not EFFECT.signature(arm, rubbed, "tilt", (0.5,)).columns.any()


def test_limits_that_are_tried_are_exceeded_for_a_known_share(arm, saturated):
    # Closed form: |sine| exceeds sin(x) for the share 1 - 2 x / pi.
    limits = [limit for (limit,) in EFFECT.shapes(arm, replace(saturated, tau=9.0 * np.ones((2000, 3))), "tilt")]
    shares = [0.4, 0.2, 0.1, 0.05, 0.02, 0.01]
    np.testing.assert_allclose(limits, [*4.0 * np.cos(np.pi / 2 * np.array(shares)), 9.0], rtol=5e-3)


def test_a_limit_is_tried_that_the_motion_shows(arm, saturated, rng):
    # Known truth: the motion needs 1.3 N m at most, whatever is commanded.
    tau = np.clip(saturated.tau, -1.3, 1.3) + 0.005 * rng.normal(size=saturated.tau.shape)
    wound_up = replace(saturated, tau=tau, logged=20.0 * saturated.logged)
    assert min(abs(limit - 1.3) for (limit,) in EFFECT.shapes(arm, wound_up, "tilt")) < 0.02


def test_noise_beyond_the_limit_is_averaged_out(arm, saturated, rng):
    # White noise of 1 N m, averaged over five samples: a command at the limit exceeds it by 0.4 / sqrt(5) on average.
    logged = saturated.logged.copy()
    logged[:, 1] = 2.5 + rng.normal(size=len(logged))
    excess = -EFFECT.torque(arm, Operation.of(arm, saturated, logged), "tilt", np.array([2.5]))[:, 1]
    assert excess.mean() == pytest.approx(0.4 / np.sqrt(5), rel=0.15)


def test_a_simulated_drive_holds_the_limit(arm, given_in_steps):
    command = np.array([[3.0, -3.0, 3.0], [1.0, 1.0, 1.0], [-9.0, 9.0, 9.0]])
    given = given_in_steps(EFFECT.simulated(arm, "tilt", np.array([2.0])), np.arange(3) * 0.01, command)
    np.testing.assert_array_equal(given, [[3.0, -2.0, 3.0], [1.0, 1.0, 1.0], [-9.0, 2.0, 9.0]])


def beyond(arm, smooth, runs: tuple[int, ...], needed: float) -> tuple[Operation, np.ndarray]:
    """A hundred samples of 10 ms; the command is beyond the limit of 2 N m in runs of so many, one sample apart."""
    excess, start = np.zeros(100), 1
    for k, run in enumerate(runs):
        excess[start : start + run] = (-1.0) ** k
        start += run + 1
    states = (x[:100] for x in (smooth.q, smooth.v, smooth.a))
    operation = Operation.of(arm, Motion(0.01 * np.arange(100), *states))
    return replace(operation, expected=needed * np.sign(excess)[:, None] * np.ones(3)), excess


@pytest.mark.parametrize(
    ("runs", "needed", "believed"),
    # By hand: 30 ms at once, 45 % of the time, and 1.2 to 2.8 N m.
    [
        ((3,), 2.0, True),
        ((2, 2, 2), 2.0, False),
        ((2, 3, 2), 2.0, True),
        ((45,), 2.0, True),
        ((46,), 2.0, False),
        ((10, 35), 2.0, True),
        ((10, 36), 2.0, False),
        ((10, 10), 1.19, False),
        ((10, 10), 0.6 * 2.0, False),
        ((10, 10), 1.4 * 2.0, False),
        ((10, 10), 1.21, True),
        ((10, 10), 2.79, True),
        ((10, 10), 2.81, False),
        ((10, 10), -2.0, False),
        ((), 2.0, False),
    ],
)
def test_a_limit_is_believed_that_holds_a_while_at_what_the_motion_needs(arm, smooth, runs, needed, believed):
    operation, excess = beyond(arm, smooth, runs, needed)
    assert _plausible(operation, 1, 2.0, excess) == believed


def test_a_command_that_begins_and_ends_beyond_the_limit_is_believed(arm, smooth):
    operation, _ = beyond(arm, smooth, (), 2.0)
    excess = np.where((np.arange(100) < 3) | (np.arange(100) >= 97), 0.5, 0.0)
    driven = replace(operation, expected=np.full((100, 3), 2.0))
    assert _plausible(driven, 1, 2.0, excess)


@pytest.mark.parametrize(
    ("run", "needed", "given"), [(8, 2.0, 1.5), (8, 1.2, 1.2), (2, 2.0, 0.4), (8, -2.0, 0.0)], ids=str
)
def test_a_torque_was_given_that_was_recorded_and_needed_for_thirty_milliseconds(arm, smooth, run, needed, given):
    # By hand: 1.5 N m in samples of 10 ms for a while, 0.4 else; what the motion needs has the same or the other sign.
    operation, _ = beyond(arm, smooth, (), 0.0)
    long = (np.arange(100) >= 40) & (np.arange(100) < 40 + run)
    command = np.where(long, -1.5, 0.4)[:, None] * np.ones(3)
    driven = replace(
        operation, logged=command, expected=np.where(long, -needed, 0.4 if needed > 0 else -0.4)[:, None] * np.ones(3)
    )
    assert largest_given(driven, 1) == pytest.approx(given)


def commanded_once(operation: Operation, given, noise: float = 0.0) -> Operation:
    """A slow command within 1 N m that goes to 3 N m once for 60 ms; ``given`` makes the needed torque of it."""
    t = operation.t
    command = np.sin(2 * np.pi * t) + 3.0 * np.exp(-(((t - 1.02) / 0.05) ** 2))
    needed = given(command) + noise * np.random.default_rng(3).standard_normal(len(t))
    everywhere = np.column_stack([needed] * 3)
    return replace(operation, tau=everywhere, expected=everywhere, logged=np.column_stack([command] * 3))


def test_a_limit_that_holds_once_for_some_milliseconds_is_tried(arm, saturated):
    # Known truth: 2 N m, which the command exceeds for 4 % of two seconds.
    driven = commanded_once(saturated, lambda command: np.clip(command, -2.0, 2.0))
    assert min(abs(limit - 2.0) for (limit,) in EFFECT.shapes(arm, driven, "tilt")) < 0.03
    assert EFFECT.signature(arm, driven, "tilt", (2.0,)).columns.any()


def test_a_drive_without_a_limit_has_no_plateau(saturated):
    driven = commanded_once(saturated, lambda command: 1.05 * command)
    assert _plateau(driven.logged[:, 1], driven.tau[:, 1]) == ()


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_supply_that_gives_way_is_no_limit(arm, saturated, share):
    # Beyond 2 N m the drive still gives a share of what more is asked for.
    driven = commanded_once(saturated, lambda x: np.clip(x, -2.0, 2.0) + share * np.maximum(x - 2.0, 0.0))
    assert not EFFECT.signature(arm, driven, "tilt", (2.0,)).columns.any()


def test_a_limit_is_believed_although_a_disturbance_hides_that_it_is_flat(arm, saturated):
    # Smooth noise of 0.15 N m, which needs an error of the slope to be counted.
    def given(command):
        return np.clip(command, -2.0, 2.0) + 0.15 * np.sin(2 * np.pi * 9.0 * saturated.t + 0.5)

    driven = commanded_once(saturated, given)
    assert EFFECT.signature(arm, driven, "tilt", (2.0,)).columns.any()


def rising(
    arm, smooth, slope: float, noise: float, dt: float = 0.01, scatter: float = 0.0
) -> tuple[Operation, np.ndarray]:
    """A command that goes by 0.1 to 2 N m beyond a limit of 2 N m either way while the needed torque rises with it.

    Below the limit the needed torque is off the command by ``noise`` either way, beyond it off the line by ``scatter``.
    """
    over = 0.1 * np.arange(1, 21)
    side = np.where(np.arange(20) % 2 == 0, 1.0, -1.0)
    command = np.concatenate([side * (2.0 + over), np.tile([1.0, -1.0], 40)])
    off = noise * np.where(np.arange(80) % 4 < 2, 1.0, -1.0)
    # Of four samples in a row the scatter has no slope.
    apart = scatter * np.tile([1.0, -1.0, -1.0, 1.0], 5)
    needed = np.concatenate([side * (2.0 + slope * (over - over.mean()) + apart), command[20:] + off])
    operation = Operation.of(arm, Motion(dt * np.arange(100), *(x[:100] for x in (smooth.q, smooth.v, smooth.a))))
    excess = np.concatenate([side * over, np.zeros(80)])
    return replace(operation, logged=command[:, None] * np.ones(3), expected=needed[:, None] * np.ones(3)), excess


@pytest.mark.parametrize(("dt", "independent"), [(0.01, 3.0), (0.1, 1.0)])
@pytest.mark.parametrize(("noise", "scatter", "counts"), [(0.0, 0.2, 0.0), (0.1, 0.2, 0.14826), (0.1, 0.05, 0.05)])
@pytest.mark.parametrize(("more", "flat"), [(-1e-3, True), (1e-3, False)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_needed_torque_is_flat_that_rises_or_falls_by_an_eighth_of_the_command_and_its_error(
    arm, smooth, dt, independent, noise, scatter, counts, more, flat, side
):
    # Closed form: a slope over excesses whose squares about their mean sum to 6.65, the noise the same within 30 ms:
    # 1.4826 times the median of what is off below the limit, or the scatter about the line if that is smaller. The
    # slope is at most two errors above an eighth, and a third is at most e times as likely: of normal errors
    # (s - 0.12)^2 - (1/3 - s)^2 = 2 error^2.
    error = counts * np.sqrt(independent / 6.65)
    steepest = min(0.12 + 2.0 * error, (2.0 * error**2 + 1.0 / 9.0 - 0.12**2) / (2.0 / 3.0 - 0.24))
    operation, excess = rising(arm, smooth, side * (steepest + more), noise, dt, scatter)
    assert _is_flat(operation, 1, 2.0, excess) is flat


def test_a_command_that_is_always_beyond_a_limit_has_no_noise_to_go_by(arm, smooth):
    for slope, flat in ((0.119, True), (0.121, False)):
        operation, excess = rising(arm, smooth, slope, 0.1)
        quiet = replace(operation, logged=np.where(excess[:, None] == 0, 0.5, operation.logged))
        assert _is_flat(quiet, 1, 2.0, excess) is flat


def test_a_command_at_one_level_beyond_the_limit_is_flat(arm, smooth):
    operation, excess = rising(arm, smooth, 0.5, 0.0)
    assert _is_flat(operation, 1, 2.0, np.sign(excess))


def test_limits_that_are_tried_next_lie_within_a_tenth_on_either_side(arm):
    assert [limit for (limit,) in EFFECT.refined(np.ones(1), (2.0,))] == pytest.approx(
        [1.8, 1.94, 1.98, 2.0, 2.02, 2.06, 2.2]
    )


@pytest.mark.parametrize(("spread", "believed"), [(0.15, True), (0.25, False)])
def test_a_needed_torque_that_is_spread_by_a_tenth_of_the_limit_is_none(arm, smooth, spread, believed):
    # By hand: twice ten samples beyond a limit of 2 N m, so much above it and so much below it. What changes from
    # sample to sample is noise of the acceleration, and averages out.
    operation, excess = beyond(arm, smooth, (10, 10), 2.0)
    off, noise = np.zeros(100), 0.3 * np.tile([1.0, 0.0, -1.0], 7)[:20]
    off[excess != 0] = spread * np.repeat([1.0, -1.0], 10) + noise
    driven = replace(operation, expected=(2.0 * np.sign(excess) + np.sign(excess) * off)[:, None] * np.ones(3))
    assert _plausible(driven, 1, 2.0, excess) is believed


@pytest.mark.parametrize(("size", "seen"), [(0.8, True), (0.8001, False)])
def test_a_limit_is_not_below_what_the_drive_has_given(arm, saturated, monkeypatch, size, seen):
    # By hand: limits of 0.8 of the torque that was given for certain, and more of it.
    monkeypatch.setattr("phantom_dyn.effects.drive.torque_saturation.largest_given", lambda *_: 2.0 * size / 0.64)
    driven = commanded_once(saturated, lambda command: np.clip(command, -2.0, 2.0))
    assert EFFECT.signature(arm, driven, "tilt", (2.0,)).columns.any() == seen


@pytest.mark.parametrize("limit", [0.7, 1.6, np.inf])
@pytest.mark.parametrize("samples", [400, 401])
def test_a_plateau_is_the_highest_level_that_the_median_stays_at(rng, samples, limit):
    # Oracle: the definition, a median above each level of its own.
    command = 2.0 * np.sin(np.linspace(0.0, 20.0, samples)) + 0.05 * rng.normal(size=samples)
    needed = np.clip(command, -limit, limit) + 0.1 * rng.normal(size=samples)
    size, along = np.abs(command), needed * np.sign(command)
    levels = np.linspace(0.0, size.max(), 201)[1:-1]
    reached = [np.median(along[size >= level]) >= level for level in levels]
    left = [float(levels[k]) for k in range(len(levels) - 1) if reached[k] and not reached[k + 1]]
    assert _plateau(command, needed) == tuple(left[-1:])


@pytest.mark.parametrize("ratio", [0.6, 1.0, 1.7])
def test_the_true_torque_is_ratio_times_the_logged_one(arm, operation, ratio):
    # Contract: true torque = ratio * tau. What is logged is what the motion needs less what the effect gives.
    needed = inverse_dynamics(arm, operation)
    logged = needed - TorqueConstant().torque(arm, operation, "tilt", np.array([ratio]))
    np.testing.assert_allclose(ratio * logged[:, 1], needed[:, 1])


def test_the_torque_is_constant(arm, operation):
    torque = TorqueOffset().torque(arm, operation, "slide", np.array([-1.3]))
    np.testing.assert_array_equal(torque, np.tile([0.0, 0.0, -1.3], (40, 1)))


def test_the_torque_is_minus_i_a(arm, operation):
    # Contract: -I a.
    torque = RotorInertia().torque(arm, operation, "tilt", np.array([0.3]))
    np.testing.assert_array_equal(torque, np.column_stack([0 * operation.t, -0.3 * operation.a[:, 1], 0 * operation.t]))
