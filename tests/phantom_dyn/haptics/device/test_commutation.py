"""Cogging by brushes under voltage amplifiers: a ring of coils, differential equations, Fourier series."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.commutation import (
    BrushMotor,
    steady_torque,
)
from phantom_dyn.haptics.device.drives import Winding

SLOW = BrushMotor(Winding(2.0), 0.02, 11)
COILED = BrushMotor(Winding(2.0, 2e-4), 0.02, 11)


def ring_resistance(bars: int, plus: list[int], minus: list[int]) -> float:
    """Between brushes that touch these bars, of a ring of coils of 1 ohm: Kirchhoff's node equations."""
    node = list(range(bars))
    for bar in plus:
        node[bar] = bars
    for bar in minus:
        node[bar] = bars + 1
    G = np.zeros((bars + 2, bars + 2))
    for k in range(bars):
        a, b = node[k], node[(k + 1) % bars]
        if a != b:
            G[[a, b], [a, b]] += 1.0
            G[[a, b], [b, a]] -= 1.0
    inside = [k for k in range(bars) if node[k] == k]
    unknown = [*inside, bars]
    current = np.zeros(len(unknown))
    current[-1] = 1.0
    return float(np.linalg.solve(G[np.ix_(unknown, unknown)], current)[-1])


@pytest.mark.parametrize("bars", [3, 7, 11])
def test_the_resistance_falls_to_n_over_n_plus_one_where_a_brush_joins_two_bars(bars):
    """Oracle: the node equations of the ring."""
    half = bars // 2
    single, joined = ring_resistance(bars, [0], [half]), ring_resistance(bars, [0], [half, half + 1])
    motor = BrushMotor(Winding(1.0), 0.02, bars)
    assert motor.joined_resistance == pytest.approx(joined / single, rel=1e-12)


def test_a_brush_switches_two_n_times_a_revolution():
    angle = np.linspace(0.0, 2 * math.pi, 200_001)
    falls = np.count_nonzero(np.diff(SLOW.resistance(angle + 0.1)) < 0)
    assert falls == 22


@pytest.mark.parametrize("speed", [20.0, 300.0])
def test_steady_torque_with_inductance_is_what_the_differential_equation_ends_at(speed):
    """Oracle: the equation of the current, integrated over forty switchings."""
    found = steady_torque(COILED, speed=speed, voltage=12.0)
    span = COILED.period / speed
    current = 0.0
    for k in range(80):
        share, R = ((0.3, COILED.joined_resistance), (0.7, 2.0))[k % 2]
        run = solve_ivp(
            lambda _, i, R=R: (12.0 - 0.02 * speed - R * i) / 2e-4, (0, share * span), [current], rtol=1e-10, atol=1e-12
        )
        current = run.y[0, -1]
    assert found.torque[0] == pytest.approx(0.02 * current, rel=1e-6)
    assert found.torque[-1] == pytest.approx(found.torque[0], rel=1e-9)


def test_inductance_smooths_the_torque_of_a_fast_motor_and_not_of_a_slow_one():
    """Closed form at rest: 1/n over a mean of 1 + w/n; fast, the current has no time to follow."""
    motor = BrushMotor(Winding(2.0, 5e-3), 0.02, 11)
    slow, fast = (steady_torque(motor, speed=speed, voltage=12.0).ripple for speed in (0.1, 500.0))
    assert slow == pytest.approx(1 / 11.3, rel=1e-3)
    assert fast < 0.1 * slow


@pytest.mark.parametrize("motor", [SLOW, COILED])
def test_the_mean_is_that_of_the_curve(motor):
    found = steady_torque(motor, speed=100.0, voltage=12.0)
    assert found.mean == pytest.approx(np.trapezoid(found.torque, found.angle) / motor.period, rel=1e-3)


def test_an_even_commutator_is_refused():
    with pytest.raises(ParameterError, match="give an odd number"):
        BrushMotor(Winding(2.0), 0.02, 10)


def test_brushes_that_always_join_are_refused():
    with pytest.raises(ParameterError, match="give one between 0 and 1"):
        BrushMotor(Winding(2.0), 0.02, 11, joined=1.0)


def test_a_motor_without_current_has_no_ripple_to_state():
    with pytest.raises(ParameterError, match="no current flows"):
        steady_torque(SLOW, speed=200.0, voltage=4.0)
