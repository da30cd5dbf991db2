"""Play of a joint and its swing."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.displaced import exact_change_by_link, load_and_inertia
from phantom_dyn.effects.transmission.backlash import Backlash, Play, play, with_unfiltered_load
from phantom_dyn.effects.transmission.transmission_compliance import (
    _NEARBY_DAMPING,
    _SOFT_SWINGS,
    TransmissionCompliance,
    _followed,
    followed_load,
    swing,
    swing_steps,
)
from phantom_dyn.motion import Motion

BACKLASH = Backlash()

GAP = 0.01

HALF = 0.5 * GAP


@pytest.fixture
def t(rng) -> np.ndarray:
    """Two seconds in uneven steps of about a millisecond."""
    return np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 2000))


@pytest.fixture
def pull(t) -> np.ndarray:
    return 5.0 * np.sin(9.0 * t) + 3.0 * np.sin(31.0 * t) + 1.0


def flights(moved: Play) -> Iterator[tuple[int, int]]:
    """First sample of each flight, and the one behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0.0], moved.loose, [0.0]])))
    return zip(edges[::2], edges[1::2], strict=True)


def fallen(t: np.ndarray, pull: np.ndarray, start: int, since: float) -> tuple[np.ndarray, np.ndarray]:
    """Way and speed at all samples of what is pulled from rest at the time ``since``, just before ``start``."""
    line = make_interp_spline(t, pull, k=1)
    speed, way = line.antiderivative(1), line.antiderivative(2)
    return way(t) - way(since) - speed(since) * (t - since), speed(t) - speed(since)


def test_a_link_in_flight_is_where_its_pull_has_brought_it(t, pull):
    moved = play(t, pull, GAP)
    met = 0
    for start, end in flights(moved):
        if start == 0 or end >= len(t) or moved.lead[start - 1] * pull[start - 1] < 0:
            continue
        side = np.sign(moved.lead[start - 1])
        since = t[start - 1] + (t[start] - t[start - 1]) * pull[start - 1] / (pull[start - 1] - pull[start])
        way, speed = fallen(t, pull, start, since)
        np.testing.assert_allclose(moved.lead[start:end], side * HALF + way[start:end], atol=1e-12)
        np.testing.assert_allclose(moved.rate[start:end], speed[start:end], atol=1e-10)
        assert abs(side * HALF + way[end - 1]) < HALF <= abs(side * HALF + way[end])
        met += 1
    assert met >= 5


def test_a_link_that_is_held_is_at_the_end_to_which_its_pull_presses_it(t, pull):
    moved = play(t, pull, GAP)
    held = moved.loose == 0
    assert 0.2 < held.mean() < 0.95
    np.testing.assert_allclose(np.abs(moved.lead[held]), HALF)
    # The sample of a landing is already held, whatever pulls there.
    landed = np.zeros(len(t), dtype=bool)
    landed[[end for _, end in flights(moved) if end < len(t)]] = True
    assert np.all(moved.lead[held & ~landed] * pull[held & ~landed] >= 0)
    assert not moved.rate[held].any()


def test_a_link_that_lands_under_a_pull_off_its_new_end_leaves_it_from_rest(t):
    # Closed form: from rest under a constant pull p the way is p t^2 / 2; the pull turns while the link is in flight.
    pull = np.where(t < 0.5, 6.0, np.where(t < 0.55, -6.0, 6.0))
    moved = play(t, pull, GAP)
    (start, _), *_ = flights(moved)
    assert moved.lead[start - 1] == HALF
    assert moved.lead[-1] == HALF
    first = next(k for k in range(len(t)) if pull[k] < 0)
    assert start == first


def test_a_link_that_is_loose_at_the_first_sample_begins_there_at_rest():
    # By hand: pulled to the lower end it lies there, whatever the pull.
    t = np.arange(5) * 0.1
    np.testing.assert_array_equal(play(t, np.full(5, -1.0), GAP).lead, -HALF)
    np.testing.assert_array_equal(play(t, np.zeros(5), GAP).lead, HALF)


def test_the_impact_is_shared_by_the_two_samples_about_the_landing(t, pull):
    # Momentum: what was missing in flight; a landing a third of the way from one sample to the next gives that sample
    # two thirds of it.
    moved, width = play(t, pull, GAP), np.gradient(t)
    met = 0
    for start, end in flights(moved):
        if start == 0 or end >= len(t) or moved.lead[start - 1] * pull[start - 1] < 0:
            continue
        since = t[start - 1] + (t[start] - t[start - 1]) * pull[start - 1] / (pull[start - 1] - pull[start])
        way = np.sign(moved.lead[start - 1]) * HALF + fallen(t, pull, start, since)[0]
        if way[end - 1] * way[end] < 0:
            continue
        lost = np.sum(pull[start:end] * width[start:end])
        late = (HALF - abs(way[end - 1])) / abs(way[end] - way[end - 1])
        assert moved.impact[end - 1] * width[end - 1] == pytest.approx((1.0 - late) * lost, rel=1e-6)
        assert moved.impact[end] * width[end] == pytest.approx(late * lost, rel=1e-6)
        met += 1
    assert met >= 5


def test_in_flight_a_drive_lacks_the_whole_load(arm, smooth):
    # Closed form: a free link takes no torque from its own drive, but for the impact.
    moved = play(smooth.t, np.divide(*load_and_inertia(smooth, 1)), GAP)
    change = with_unfiltered_load(smooth, "tilt", np.ones(1), np.array([GAP]))[:, 1]
    free = (moved.loose > 0) & (moved.impact == 0)
    assert free.sum() > 20
    np.testing.assert_allclose(change[free], -load_and_inertia(smooth, 1)[0][free], atol=1e-9)


def test_other_drives_feel_the_link_where_it_is(arm, smooth):
    # Inverse dynamics of the displaced link, for a play so small that it is linear; so does its own drive when it is
    # held, but for the impacts.
    gap = 1e-6
    load, inertia = load_and_inertia(smooth, 1)
    moved = play(smooth.t, load / inertia, gap)
    gained = moved.impact - load / inertia * moved.loose
    exact = exact_change_by_link(arm, smooth, 1, -moved.lead, -moved.rate, gained)
    change = with_unfiltered_load(smooth, "tilt", np.array([0.5]), np.array([gap]))
    held = moved.loose == 0
    np.testing.assert_allclose(change[:, [0, 2]], 0.5 * exact[:, [0, 2]], atol=1e-5)
    np.testing.assert_allclose(change[held, 1], 0.5 * exact[held, 1], atol=1e-5)


def test_a_load_that_touches_zero_has_not_changed_its_sign(planar):
    # By hand: stretched out, hanging down, the elbow carries nothing; it comes from one side and goes back to it.
    q = np.zeros((9, 2))
    q[:, 1] = 0.1 * np.abs(np.arange(9.0) - 4.0)
    touching = Operation.of(planar, Motion(np.arange(9) / 100.0, q, 0 * q, 0 * q))
    assert touching.transmitted[4, 1] - touching.own_friction[4, 1] == 0.0
    assert BACKLASH.shapes(planar, touching, "elbow") == ()
    assert BACKLASH.untestable(planar, touching, "elbow") == "the transmitted torque never changes sign"


def test_a_play_under_a_load_that_keeps_its_sign_looks_like_an_offset_of_half_of_it(planar):
    # Inverse dynamics: with a load that keeps its sign, the link is half the gap behind its motor at all times.
    t = np.arange(200) / 100.0
    q = np.column_stack([0.0 * t, 0.8 + 0.3 * np.sin(3.0 * t)])
    v = np.column_stack([0.0 * t, 0.9 * np.cos(3.0 * t)])
    a = np.column_stack([0.0 * t, -2.7 * np.sin(3.0 * t)])
    operation = Operation.of(planar, Motion(t, q, v, a))
    load = operation.transmitted[:, 1]
    offset = 0.5 * GAP * np.sign(load.mean())
    assert load.min() * load.max() > 0
    assert BACKLASH.looks_like(planar, operation, "elbow", "encoder_offset", np.array([offset]))
    assert not BACKLASH.looks_like(planar, operation, "elbow", "encoder_offset", np.array([-offset]))


def test_a_play_under_a_load_of_both_signs_does_not_look_like_an_offset(arm, smooth):
    assert not BACKLASH.looks_like(arm, smooth, "tilt", "encoder_offset", np.array([0.5 * GAP]))


def test_the_share_of_a_play_is_one_give_or_take_a_half(planar):
    assert BACKLASH.coefficient_bounds(planar, "elbow", (GAP,)) == ((0.5, 1.5),)


EFFECT = TransmissionCompliance()

EDGES = (8.0, 12.0, 20.0)


def test_a_swing_obeys_the_trapezoidal_rule(rng):
    pull, spring, drag = rng.normal(size=60), rng.uniform(100, 900, 60), rng.uniform(0, 20, 60)
    half = rng.uniform(0.5e-3, 5e-3, 59)
    place, speed, gain = swing_steps(half, pull, spring, drag)
    np.testing.assert_allclose(np.diff(place), half * (speed[1:] + speed[:-1]), atol=1e-14)
    np.testing.assert_allclose(np.diff(speed), half * (gain[1:] + gain[:-1]), atol=1e-13)
    np.testing.assert_allclose(gain[1:], (pull - drag * speed - spring * place)[1:], atol=1e-10)
    assert (place[0], speed[0], gain[0]) == (pull[0] / spring[0], 0.0, 0.0)


@pytest.fixture
def short(planar, rng) -> Operation:
    """Fifteen samples of two links with rotors and friction, too few to be filtered."""
    q, v, a = rng.uniform(-3.0, 3.0, (3, 15, 2))
    return Operation.of(planar, Motion(np.cumsum(rng.uniform(1e-3, 3e-3, 15)), q, v, a))


def test_a_link_swings_on_spring_and_gravity_under_its_load(short):
    # m delta'' + (d + c) delta' + (k + g) delta = -load, with a damping ratio of a half while the start is forgotten.
    stiffness = 300.0
    delta, speed, gain = swing(short, 1, stiffness)
    inertia = short.partials[2][:, 1, 1] - short.robot.rotor_inertia[1]
    to_q, to_v = short.partials[0][:, 1, 1], short.partials[1][:, 1, 1]
    damping = np.sqrt(stiffness * inertia) + to_v
    assert damping.min() > 0
    left = inertia * gain + damping * speed + (stiffness + to_q) * delta + short.transmitted[:, 1]
    np.testing.assert_allclose(left[1:], 0.0, atol=1e-9)
    assert delta[0] == pytest.approx(-short.transmitted[0, 1] / (stiffness + to_q[0]))


@pytest.mark.parametrize(("stiffness", "ratio"), [(300.0, 0.1), (30.0, 0.04)])
def test_from_rest_a_stiff_spring_swings_with_a_tenth_and_a_soft_one_rings_for_longer(short, stiffness, ratio):
    # The same equation; at rest the spring is in balance, and nothing has to be forgotten.
    still = Operation.of(short.robot, Motion(short.t, short.q, np.vstack([np.zeros(2), short.v[1:]]), short.a))
    delta, speed, gain = swing(still, 1, stiffness)
    inertia = still.partials[2][:, 1, 1] - still.robot.rotor_inertia[1]
    to_q, to_v = still.partials[0][:, 1, 1], still.partials[1][:, 1, 1]
    damping = np.maximum(2.0 * ratio * np.sqrt(stiffness * inertia) + to_v, 0.0)
    spring = np.maximum(stiffness + to_q, 0.1 * stiffness)
    left = inertia * gain + damping * speed + spring * delta + still.transmitted[:, 1]
    np.testing.assert_allclose(left[1:], 0.0, atol=1e-9)


def test_what_gravity_takes_off_a_spring_leaves_a_tenth_of_it(short):
    # A spring of 0.01 N m/rad holds no link up.
    to_q = short.partials[0][:, 1, 1]
    first = int(np.argmin(to_q))
    assert to_q[first] < -0.01
    rest = Operation.of(short.robot, Motion(*(x[first:] for x in (short.t, short.q, short.v, short.a))))
    assert swing(rest, 1, 0.01)[0][0] == pytest.approx(-rest.transmitted[0, 1] / 0.001)


def test_compliances_that_are_tried_swing_between_70_and_1_hertz(arm, smooth):
    # Closed form: 1 / (I w^2) of the middle inertia. Soft springs, which swing within the band, are tried more densely.
    inertia = np.median(load_and_inertia(smooth, 1)[1])
    tried, dampings = zip(*EFFECT.shapes(arm, smooth, "tilt"), strict=True)
    frequencies = 1.0 / (2 * np.pi * np.sqrt(np.array(tried) * inertia))
    np.testing.assert_allclose(frequencies, [70.0, 35.0, 22.0, 14.0, 9.0, 7.2, 5.7, 4.5, 3.6, 2.9, 2.3, 1.8, 1.45])
    assert dampings == (0.1,) * 5 + (0.04,) * 8


@pytest.mark.parametrize(("true_hz", "true_damping"), [(1.6, 0.02), (2.6, 0.1), (4.0, 0.03)])
def test_some_shape_resembles_any_soft_spring(true_hz, true_damping):
    # Oracle: the swing itself, of an inertia of 1 kg m^2 under a torque that is rich up to 5 Hz. A shape that is off by
    # half a step of the grid shares a quarter of its squares or more: enough to be found and refined. None did of 9 Hz.
    t = np.arange(0.0, 20.0, 2e-3)
    pull = sum(np.sin(2 * np.pi * f * t + 7.0 * f * f) for f in np.arange(0.3, 5.0, 0.35))
    half = 0.5 * np.diff(t)

    def acceleration(hz: float, damping: float) -> np.ndarray:
        w = 2 * np.pi * hz
        return swing_steps(half, pull, np.full(len(t), w * w), np.full(len(t), 2 * damping * w))[2]

    true = acceleration(true_hz, true_damping)
    left = []
    for hz in _SOFT_SWINGS:
        for damping in (0.04, *(0.04 * share for share in _NEARBY_DAMPING)):
            column = acceleration(hz, damping)
            left.append(1.0 - (column @ true) ** 2 / ((column @ column) * (true @ true)))
    assert min(left) < 0.75


@pytest.mark.parametrize("coefficient", [0.0, -1e-3])
def test_no_compliance_is_a_very_stiff_spring(arm, coefficient):
    assert EFFECT.from_coefficients(arm, "tilt", np.array([coefficient]), (1e-3, 0.1)) == pytest.approx([1e10])
    assert EFFECT.at_estimate(np.array([coefficient]), (1e-3, 0.1)) == (1e-10, 0.1)


def test_a_link_ahead_of_its_motor_is_where_it_swings(arm, smooth):
    ahead = EFFECT.link_ahead(smooth, "tilt", np.array([400.0]))
    np.testing.assert_array_equal(ahead[:, 1], swing(smooth, 1, 400.0)[0])
    assert not ahead[:, [0, 2]].any()


def test_the_load_that_is_followed_ends_at_an_edge_by_the_middle_inertia(smooth):
    load, inertia = load_and_inertia(smooth, 1)
    found = followed_load(smooth, 1, EDGES)
    np.testing.assert_allclose(found[0], _followed(smooth.t, load, 12.0))
    np.testing.assert_array_equal(found[1], inertia)
    assert followed_load(smooth, 1, EDGES)[0] is found[0]


@pytest.mark.parametrize(("joint", "unit"), [("tilt", "rad/(N m)"), ("slide", "m/N")])
def test_a_compliance_has_the_unit_of_one_over_a_stiffness(arm, smooth, joint, unit):
    assert EFFECT.probe_unit(arm, joint, "compliance") == unit
    assert EFFECT.signature(arm, smooth, joint, (1e-3, 0.1)).units == (unit,)
