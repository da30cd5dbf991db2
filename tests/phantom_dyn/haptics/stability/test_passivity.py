"""Passive walls: closed forms of Colgate and Schenkel, and the worst motion over many aliases."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.haptics.stability.passivity import passive_damping

T = 1e-3


@pytest.mark.parametrize("virtual_damping", [0.0, 2.0, -2.0])
def test_without_delay_it_is_the_condition_of_colgate_and_schenkel(virtual_damping):
    # Closed form: b > K T / 2 + |B|.
    found = passive_damping(3000.0, period=T, virtual_damping=virtual_damping)
    assert found == pytest.approx(1.5 + abs(virtual_damping), rel=1e-6)


@pytest.mark.parametrize("steps", [1, 4])
def test_a_spring_behind_whole_periods_needs_what_the_linear_condition_says(steps):
    # Closed form: the Dirichlet kernel is greatest at zero frequency, K (T/2 + t_d).
    assert passive_damping(1000.0, period=T, delay=steps * T) == pytest.approx(1000 * (0.5 + steps) * T, rel=1e-6)


@pytest.mark.parametrize(("delay", "virtual_damping"), [(0.0, 1.0), (0.3e-3, 0.0), (1e-3, 2.0), (1.7e-3, 1.0)])
def test_it_is_the_worst_motion_over_many_aliases(delay, virtual_damping):
    # Oracle: largest eigenvalue of the power as a Hermitian form of 2 x 4000 + 1 alias velocities.
    K, n = 1000.0, np.arange(-4000, 4001)
    worst = -np.inf
    for x in np.linspace(0.05, np.pi, 60):
        w = (x + 2 * np.pi * n) / T
        z = np.exp(1j * x)
        wall = K + virtual_damping / T * (1 - 1 / z)
        force = wall * (1 - 1 / z) / (1j * w) * np.exp(-1j * w * delay) / T  # per unit of the sampled position
        position = 1 / (1j * w)
        # Power Re(sum conj(v) force S), S = sum position v: Hermitian part of an outer product, eigenvalues by 2 x 2.
        basis = np.stack([np.conj(position), force], axis=1)
        r = np.linalg.qr(basis, mode="r")
        inner = np.outer(r[:, 1], np.conj(r[:, 0]))
        worst = max(worst, np.linalg.eigvalsh(-0.5 * (inner + inner.conj().T)).max())
    found = passive_damping(K, period=T, delay=delay, virtual_damping=virtual_damping)
    assert worst <= found * (1 + 1e-6)
    assert found == pytest.approx(worst, rel=0.02)
