"""A link that swings on its spring. Oracle: the equations of the trapezoidal rule and of the swing at every sample."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.displaced import link_load, load_and_inertia
from phantom_dyn.effects.transmission.transmission_compliance import (
    TransmissionCompliance,
    _edge,
    _followed,
    followed_load,
    swing,
    swing_steps,
)
from phantom_dyn.motion import Motion

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
    # m delta'' + (d + c) delta' + (k + g) delta = -load, with a damping ratio of a tenth.
    stiffness = 300.0
    delta, speed, gain = swing(short, 1, stiffness)
    inertia = short.partials[2][:, 1, 1] - short.robot.rotor_inertia[1]
    to_q, to_v = short.partials[0][:, 1, 1], short.partials[1][:, 1, 1]
    damping = 0.2 * np.sqrt(stiffness * inertia) + to_v
    assert damping.min() > 0
    left = inertia * gain + damping * speed + (stiffness + to_q) * delta + link_load(short, 1)
    np.testing.assert_allclose(left[1:], 0.0, atol=1e-9)
    assert delta[0] == pytest.approx(-link_load(short, 1)[0] / (stiffness + to_q[0]))


def test_what_gravity_takes_off_a_spring_leaves_a_tenth_of_it(short):
    # A spring of 0.01 N m/rad holds no link up.
    to_q = short.partials[0][:, 1, 1]
    first = int(np.argmin(to_q))
    assert to_q[first] < -0.01
    rest = Operation.of(short.robot, Motion(*(x[first:] for x in (short.t, short.q, short.v, short.a))))
    assert swing(rest, 1, 0.01)[0][0] == pytest.approx(-link_load(rest, 1)[0] / 0.001)


def test_compliances_that_are_tried_swing_between_70_and_9_hertz(arm, smooth):
    # Closed form: 1 / (I w^2) of the middle inertia.
    inertia = np.median(load_and_inertia(smooth, 1)[1])
    tried = [compliance for (compliance,) in EFFECT.shapes(arm, smooth, "tilt")]
    frequencies = 1.0 / (2 * np.pi * np.sqrt(np.array(tried) * inertia))
    np.testing.assert_allclose(frequencies, [70.0, 35.0, 22.0, 14.0, 9.0])


@pytest.mark.parametrize("coefficient", [0.0, -1e-3])
def test_no_compliance_is_a_very_stiff_spring(arm, coefficient):
    assert EFFECT.from_coefficients(arm, "tilt", np.array([coefficient]), (1e-3,)) == pytest.approx([1e10])
    assert EFFECT.at_estimate(np.array([coefficient]), (1e-3,)) == (1e-10,)


def test_a_link_ahead_of_its_motor_is_where_it_swings(arm, smooth):
    ahead = EFFECT.link_ahead(smooth, "tilt", np.array([400.0]))
    np.testing.assert_array_equal(ahead[:, 1], swing(smooth, 1, 400.0)[0])
    assert not ahead[:, [0, 2]].any()


def test_the_column_is_the_torque_of_the_displaced_link_over_the_compliance(arm, smooth):
    # To first order, as close as squares of the deflection allow.
    stiffness = 1e5
    column = EFFECT.signature(arm, smooth, "tilt", (1 / stiffness,)).columns[:, :, 0]
    law = EFFECT.torque(arm, smooth, "tilt", np.array([stiffness]))
    np.testing.assert_allclose(law, -column / stiffness, atol=1e-2 * np.abs(law).max())


def test_at_its_edge_a_load_is_followed_by_half_and_without_delay():
    # Closed form: a Butterworth filter takes 3 dB off at its edge, passed twice it takes six.
    t = np.arange(3000) / 500.0
    wave = np.sin(2 * np.pi * 10.0 * t)
    np.testing.assert_allclose(_followed(t, wave, 10.0)[500:-500], 0.5 * wave[500:-500], atol=1e-3)
    np.testing.assert_allclose(_followed(t, np.full(3000, 2.0), 10.0), 2.0)
    np.testing.assert_allclose(_followed(t[:20], np.full(20, 2.0), 10.0), 2.0)


@pytest.mark.parametrize(("samples", "edge", "kept"), [(15, 10.0, True), (16, 10.0, False), (100, 201.0, True)])
def test_a_load_is_not_filtered_where_there_is_nothing_to_filter(rng, samples, edge, kept):
    load = rng.normal(size=samples)
    assert np.array_equal(_followed(np.arange(samples) / 500.0, load, edge), load) is kept


def test_few_samples_end_at_the_middle_edge():
    assert _edge(np.arange(15) / 500.0, np.ones(15), 0.1, 1e-4, EDGES) == 12.0


def test_the_load_that_is_followed_ends_at_an_edge_by_the_middle_inertia(smooth):
    load, inertia = load_and_inertia(smooth, 1)
    found = followed_load(smooth, 1, EDGES)
    np.testing.assert_allclose(found[0], _followed(smooth.t, load, 12.0))
    np.testing.assert_array_equal(found[1], inertia)
    assert followed_load(smooth, 1, EDGES)[0] is found[0]


@pytest.mark.parametrize(("joint", "unit"), [("tilt", "rad/(N m)"), ("slide", "m/N")])
def test_a_compliance_has_the_unit_of_one_over_a_stiffness(arm, smooth, joint, unit):
    assert EFFECT.probe_unit(arm, joint, "compliance") == unit
    assert EFFECT.signature(arm, smooth, joint, (1e-3,)).units == (unit,)
