"""Simulated cheap hardware: axis, switch of the gap, virtual mass, workstation."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import butter

from phantom_dyn.effects.friction.presliding_friction import stick_step
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.cheap.cheap_axis import (
    WORKSTATION,
    CheapAxis,
    CoggingTorque,
    StickingFriction,
    VirtualMass,
    cheap_rotation,
    cheap_translation,
)
from phantom_dyn.haptics.cheap.cheap_hardware import (
    at_rest,
    butterworth_weights,
    coupling_force,
    mass_step,
    rendered,
    run_cycle,
    side_of,
)

RATES = [500, 1000, 2000]

FRICTION = StickingFriction(torque=2.0, displacement=100e-6, stick_velocity=5e-3)

GAP = CheapAxis(mass=VirtualMass(0.2, 600.0), gap=1e-3, cutoff_hz=np.inf)

EVERYTHING = cheap_translation(slip=1.0, order=600.0, limit=2.0)


def hand(rate: float, seconds: float = 6.0, amplitude: float = 0.01, hz: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """A hand that swings the probe to and fro, as in the seed's Figure 9."""
    t = np.arange(round(seconds * rate)) / rate
    return t, amplitude * np.sin(2 * np.pi * hz * t)


def uneven(rng: np.random.Generator, count: int) -> np.ndarray:
    """Sample times of a rate that wanders between 500 and 2000 Hz, the published range."""
    return np.cumsum(rng.uniform(1 / 2000, 1 / 500, count))


def creeping(rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Figure 8: a probe that slows down below the stick velocity, creeps on, turns and speeds up again."""
    t = np.arange(round(2.0 * rate)) / rate
    v = np.interp(t, [0.0, 0.3, 0.4, 0.6, 0.7, 1.2, 1.5, 2.0], [0.05, 0.05, 1e-4, 1e-4, -1e-3, -1e-3, -0.05, -0.05])
    return t, np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) / rate)])


def test_with_everything_off_the_hand_feels_what_is_asked_for(rng):
    t = uneven(rng, 500)
    x, force = 0.01 * rng.standard_normal((2, 500))
    np.testing.assert_array_equal(rendered(CheapAxis(), t, x, force).force, force)


def test_without_friction_force_the_device_is_the_identity_too(rng):
    # Every part there, each of no size.
    axis = CheapAxis(friction=StickingFriction(0.0, 1e-4, 5e-3), cogging=CoggingTorque((600.0,), (0.0,), (0.0,)))
    t = uneven(rng, 500)
    x, force = 0.01 * rng.standard_normal((2, 500))
    np.testing.assert_array_equal(rendered(axis, t, x, force).force, force)


def test_cogging_takes_out_no_work_over_a_period():
    # Closed form: the integral of a sine over its period.
    x = np.linspace(0.0, 2 * np.pi / 600.0, 20_001)
    axis = CheapAxis(cogging=CoggingTorque((600.0,), (0.6,), (0.4,)))
    force = rendered(axis, np.arange(len(x)) / 1000.0, x, 0 * x).force
    assert np.abs(force).max() == pytest.approx(0.6, rel=1e-6)
    assert np.trapezoid(force, x) == pytest.approx(0.0, abs=1e-12)


def test_friction_is_the_catalogues_law_of_the_probes_position_and_filtered_velocity(rng):
    t = uneven(rng, 1000)
    x = 0.01 * np.sin(5 * t)
    out = rendered(CheapAxis(friction=FRICTION), t, x, 0 * x)
    theta = np.array([FRICTION.torque, FRICTION.displacement, FRICTION.static_ratio, FRICTION.stick_velocity])
    state, expected = np.array([np.nan, 0.0, 0.0]), []
    for place, speed in zip(x, out.velocity, strict=True):
        state, torque = stick_step(state, place, speed, theta)
        expected.append(torque)
    np.testing.assert_array_equal(out.force, expected)


@pytest.mark.parametrize("rate", RATES)
def test_the_largest_friction_is_that_of_the_stuck_spring(rate):
    # Published: 1.05 times the friction in slip, at every rate.
    t, x = creeping(rate)
    force = rendered(CheapAxis(friction=FRICTION), t, x, 0 * x).force
    assert np.abs(force).max() / FRICTION.torque == pytest.approx(1.05, abs=0.02)


@pytest.mark.parametrize("rate", RATES)
def test_friction_drops_on_sticking_grows_while_the_hand_creeps_and_changes_sign_with_it(rate):
    # Published behaviour: Figure 8, and a force just after sticking of at most a quarter of that in slip.
    t, x = creeping(rate)
    out = rendered(CheapAxis(friction=FRICTION), t, x, 0 * x)
    k = int(np.flatnonzero(out.stuck & (t > 0.1))[0])
    assert out.force[k - 1] == -FRICTION.torque
    assert abs(out.force[k]) <= 0.26 * FRICTION.torque
    assert (np.diff(out.force[(t >= t[k]) & (t < 0.6)]) < 0).all()
    back = int(np.flatnonzero((out.force > 0) & (t > 0.6))[0])
    assert out.stuck[back]
    assert out.force[-1] == FRICTION.torque
    assert not out.stuck[-1]


def test_the_filter_lets_friction_stick_although_the_encoder_is_coarse():
    # Published: 8 um, quanta of 4, 8 and 16 mm/s against a stick velocity of 5 mm/s; the hand creeps at 2 mm/s.
    t = np.arange(2000) / 2000.0
    x = np.round(2e-3 * t / 8e-6) * 8e-6
    out = rendered(CheapAxis(friction=FRICTION), t, x, 0 * x)
    raw = np.abs(np.diff(x)) * 2000.0
    assert raw.max() == pytest.approx(16e-3)
    assert np.abs(out.velocity[1000:]).max() < 5e-3


@pytest.mark.parametrize("rate", RATES)
def test_a_mass_in_a_gap_hits_both_walls_every_period(rate):
    # Published: Figure 9 (0.2 kg, 600 N/m, 1 mm, +-10 mm at 0.7 Hz): two contacts a period.
    t, x = hand(rate, seconds=0.5 + 5 / 0.7)
    axis = CheapAxis(mass=VirtualMass(0.2, 600.0), gap=1e-3)
    contact = rendered(axis, t, x, 0 * x).contact[t > 0.5]
    assert np.count_nonzero(~contact[:-1] & contact[1:]) == 2 * 5


@pytest.mark.parametrize(("rate", "apart"), [(500, 0.567e-3), (1000, 0.571e-3), (2000, 0.572e-3)])
def test_the_mass_stays_within_the_gap_and_the_bend_of_its_coupling(rate, apart):
    # Computed with another integrator and without the velocity's filter; half the gap and M a / K are 0.565 mm.
    t, x = hand(rate)
    out = rendered(GAP, t, x, 0 * x)
    assert np.abs(x - out.mass_position)[t > 3].max() == pytest.approx(apart, rel=0.02)
    assert np.abs(out.coupling).max() == pytest.approx(0.715, rel=0.04)


def test_the_filter_of_the_velocity_changes_the_play_by_little():
    # Known truth: the same without it; 70 Hz against contacts that last tens of milliseconds.
    t, x = hand(1000)
    bare, filtered = (x - rendered(axis, t, x, 0 * x).mass_position for axis in (GAP, replace(GAP, cutoff_hz=70.0)))
    np.testing.assert_allclose(filtered, bare, atol=0.08e-3)


def test_a_stiff_coupling_is_the_rotor_inertia_of_the_catalogue():
    # Known truth: -M a of the motion, late by the mean of 12 samples.
    t, x = hand(1000.0, seconds=4.0, hz=1.0)
    out = rendered(CheapAxis(mass=VirtualMass(0.1, 1e5)), t, x, 0 * x)
    late = t - 12e-3
    expected = 0.1 * 0.01 * (2 * np.pi) ** 2 * np.sin(2 * np.pi * late)
    np.testing.assert_allclose(out.force[1000:], expected[1000:], atol=0.02 * np.abs(expected).max())


@pytest.mark.parametrize(("rate", "degrees"), [(500, 51.8), (1000, 25.9), (2000, 13.0)])
def test_the_mean_over_25_samples_is_late_as_published(rate, degrees):
    # Closed form: 12 samples; at 6 Hz these angles, and nothing is left at rate / 25.
    t, x = hand(rate, seconds=4.0, amplitude=1e-3, hz=6.0)
    out = rendered(CheapAxis(mass=VirtualMass(0.1, 150.0)), t, x, 0 * x)
    wave = np.exp(-2j * np.pi * 6.0 * t)[t >= 2]
    late = np.angle((out.coupling[t >= 2] @ wave) / (out.force[t >= 2] @ wave), deg=True)
    assert late == pytest.approx(degrees, abs=0.1)
    t, x = hand(rate, seconds=4.0, amplitude=1e-4, hz=rate / 25)
    null = rendered(CheapAxis(mass=VirtualMass(0.1, 150.0)), t, x, 0 * x)
    assert np.abs(null.force[t >= 3]).max() < 1e-3 * np.abs(null.coupling[t >= 3]).max()


def test_in_the_gap_nothing_but_the_mass_is_felt():
    # Figure 7: the switch blocks the virtual environment, cogging and friction.
    t, x = hand(1000.0)
    out = rendered(EVERYTHING, t, x, np.full(len(t), 1.5))
    mean = np.convolve(out.coupling, np.ones(25) / 25)[: len(t)]
    direct = out.force - mean
    assert (~out.contact).sum() > 100
    np.testing.assert_allclose(direct[~out.contact], 0.0, atol=1e-12)
    assert (np.abs(direct[out.contact]) > 0.1).mean() > 0.9


def test_a_rate_that_wanders_gives_what_a_steady_one_does(rng):
    # Known truth: the same motion sampled at 2000 Hz.
    axis = CheapAxis(mass=VirtualMass(0.2, 600.0), gap=1e-3)
    steady, wandering = np.arange(8000) / 2000.0, uneven(rng, 3000)
    apart = []
    for t in (steady, wandering):
        x = 0.01 * np.sin(2 * np.pi * 0.7 * t)
        apart.append(x - rendered(axis, t, x, 0 * x).mass_position)
    np.testing.assert_allclose(apart[1], np.interp(wandering, steady, apart[0]), atol=0.06e-3)


def test_one_cycle_after_the_other_is_the_whole(rng):
    t = uneven(rng, 300)
    x, force = 0.01 * np.sin(20 * t), rng.standard_normal(300)
    state, out = at_rest(), []
    for dt, place, asked in zip(np.diff(t, prepend=t[0]), x, force, strict=True):
        state, given = run_cycle(EVERYTHING, state, float(dt), float(place), float(asked))
        out.append(given)
    np.testing.assert_array_equal(out, rendered(EVERYTHING, t, x, force).force)


@pytest.mark.parametrize(
    ("t", "words"),
    [
        ([0.0, 0.01, 0.02], "up to 10 ms apart and the velocity is filtered at 70 Hz"),
        ([0.0, 0.0, 0.1], "do not increase"),
    ],
)
def test_times_that_the_filter_cannot_take_are_refused(t, words):
    with pytest.raises(ParameterError, match=words):
        rendered(CheapAxis(), np.array(t), np.zeros(3), np.zeros(3))


def test_the_columns_of_the_printed_table_stand_where_their_units_belong():
    # Published (Table 2, friction unswapped): 100 um and 5 mm/s for a translation, 5 mrad and 6 deg/s for a rotation.
    translation = cheap_translation(slip=1.0, order=600.0, limit=11.0).friction
    rotation = cheap_rotation(slip=0.05, order=20.0, limit=0.47).friction
    assert translation == StickingFriction(1.0, 100e-6, 5e-3, 1.05)
    assert rotation == StickingFriction(0.05, 5e-3, float(np.deg2rad(6.0)), 1.05)


def test_the_other_figures_are_those_of_the_table():
    translation = cheap_translation(slip=1.0, order=600.0, limit=11.0)
    rotation = cheap_rotation(slip=0.05, order=20.0, limit=0.47)
    assert (translation.gap, rotation.gap) == (1e-3, pytest.approx(np.deg2rad(2.0)))
    assert translation.mass == VirtualMass(0.1, 150.0)
    assert rotation.mass == VirtualMass(1e-3, 1.0)
    assert translation.cogging == CoggingTorque((600.0,), (0.6,), (0.0,))
    assert rotation.cogging == CoggingTorque((20.0,), (0.04,), (0.0,))


def test_the_period_of_the_mass_is_near_the_published_time_constant():
    # Published: T = 150 ms; 2 pi sqrt(M/K) is 162 ms at 0.1 kg and 150 N/m, 150 ms at 0.0855 kg.
    assert VirtualMass(0.1, 150.0).period == pytest.approx(0.162, abs=5e-4)
    assert VirtualMass(0.0855, 150.0).period == pytest.approx(0.150, abs=5e-4)
    assert VirtualMass(1e-3, 1.0).period == pytest.approx(0.199, abs=5e-4)


def test_damping_is_critical_unless_it_is_given():
    # Closed form: 2 sqrt(M K); the printed 0.05 would be 0.0065 of it in N s/m.
    assert VirtualMass(0.1, 150.0).damping == pytest.approx(7.746, abs=1e-3)
    assert VirtualMass(0.1, 150.0, 0.05).damping == 0.05
    assert pytest.approx(0.0065, abs=1e-4) == 0.05 / 7.746


def test_a_gap_without_a_mass_is_refused():
    with pytest.raises(ParameterError, match=r"a gap of 0.001 and no mass: a play is between two masses"):
        CheapAxis(gap=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: VirtualMass(0.0, 1.0), "The inertia of a VirtualMass is 0.0: give a number above 0"),
        (
            lambda: StickingFriction(-1.0, 1e-4, 5e-3),
            "torque of a StickingFriction is -1.0: give a number of 0 or more",
        ),
        (lambda: CheapAxis(limit=-1.0), "The limit of a cheap axis is -1"),
        (lambda: CoggingTorque((1.0, 2.0), (0.1,), (0.0,)), "2 orders, 1 amplitudes and 1 phases"),
    ],
)
def test_impossible_numbers_are_refused_in_a_sentence(make, words):
    with pytest.raises(ParameterError, match=words):
        make()


@pytest.mark.parametrize(("apart", "side"), [(0.6e-3, 1.0), (0.4e-3, 0.0), (-0.4e-3, 0.0), (-0.6e-3, -1.0)])
def test_the_probe_presses_the_wall_that_it_is_beyond(apart, side):
    # Published: (1) of the seed, a gap of 1 mm.
    assert side_of(apart, 1e-3) == side


def test_without_a_gap_there_is_always_contact():
    assert {abs(side_of(apart, 0.0)) for apart in (-1e-3, 0.0, 1e-3)} == {1.0}


def test_the_spring_starts_at_the_wall_without_a_jump():
    # (2) is printed with a jump of K d/2, 0.3 N for 600 N/m and 1 mm; with the attachment of (1) it is continuous.
    assert coupling_force(0.5e-3, 0.0, 1.0, 1e-3, 600.0, 0.0) == 0.0
    assert coupling_force(0.6e-3, 0.0, 1.0, 1e-3, 600.0, 0.0) == pytest.approx(-600.0 * 0.1e-3)


def test_in_the_gap_a_fifth_of_the_damping_acts_between_probe_and_mass():
    # Published: B1 = 0.2 B2.
    assert coupling_force(0.0, 0.3, 0.0, 1e-3, 600.0, 10.0) == pytest.approx(-0.2 * 10.0 * 0.3)


@pytest.mark.parametrize(
    ("rate", "b", "a"), [(500, 0.319989, -0.360022), (1000, 0.182690, -0.634619), (2000, 0.099424, -0.801151)]
)
def test_weights_of_the_filter_are_the_published_ones(rate, b, a):
    # Published figures, and scipy's own design.
    assert butterworth_weights(1.0 / rate, 70.0) == (pytest.approx(b, abs=5e-7), pytest.approx(a, abs=5e-7))
    numerator, denominator = np.array(butter(1, 70.0, fs=rate))
    np.testing.assert_allclose(butterworth_weights(1.0 / rate, 70.0), [numerator[1], denominator[1]], rtol=1e-12)


def test_a_mass_on_its_coupling_swings_as_the_closed_form_says(rng):
    # Known truth: scipy's integrator on the same equation; steps between 0.5 and 2 ms.
    mass, stiffness, damping = 0.1, 150.0, 1.5
    x, v, t = 0.004, 0.0, 0.0
    for dt in rng.uniform(1 / 2000, 1 / 500, 200):
        x, v = mass_step(x, v, dt, mass, 0.0, stiffness, damping, 0.0)
        t += dt
    true = solve_ivp(
        lambda _, y: [y[1], -(stiffness * y[0] + damping * y[1]) / mass], (0, t), [0.004, 0.0], rtol=1e-10, atol=1e-14
    ).y[:, -1]
    # The phase of the midpoint rule is right to a twelfth of (w h)^2, 1e-4 here, of some ten radians.
    np.testing.assert_allclose(
        [x, v / np.sqrt(stiffness / mass)], [true[0], true[1] / np.sqrt(stiffness / mass)], atol=2e-3 * 0.004
    )


def test_no_stiffness_makes_the_mass_unstable():
    # A thousand times what the explicit rule would bear at 1 ms.
    x, v = 0.001, 0.0
    for _ in range(2000):
        x, v = mass_step(x, v, 1e-3, 0.1, 0.0, 4e8, 0.0, 0.0)
    assert abs(x) <= 0.001 * (1 + 1e-9)


def test_a_rotary_axis_is_in_radians():
    pitch = WORKSTATION["pitch"]
    assert pitch.resolution == pytest.approx(0.01 * math.pi / 180)
    assert pitch.travel == pytest.approx(100 * math.pi / 180)


def test_the_insertion_is_in_metres():
    assert (WORKSTATION["insertion"].travel, WORKSTATION["insertion"].resolution) == (0.170, 8e-6)


@pytest.mark.parametrize(("name", "held"), [("insertion", 11.0), ("handle grip", 0.15), ("tip twist", 0.0)])
def test_a_motor_holds_its_continuous_force(name, held):
    t = np.arange(10) / 1000.0
    out = rendered(WORKSTATION[name].motor, t, 0 * t, np.full(10, 50.0))
    np.testing.assert_allclose(out.force, held)
