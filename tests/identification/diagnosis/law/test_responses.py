"""Oracles: `scipy.signal`'s simulation of the same transfer functions, and Laguerre's orthonormality."""

import numpy as np
from scipy import signal

from identification.diagnosis.law.responses import delayed, laguerre, laguerre_answer, resonator

DT = 0.004
T = np.arange(5000) * DT
X = 0.7 + np.sin(2.0 * T) + 0.4 * np.sin(7.0 * T + 1.0)


def test_a_resonator_is_the_second_order_of_held_inputs():
    w, d = 2 * np.pi * 1.3, 0.2
    a, b, c, _, _ = signal.cont2discrete(
        (np.array([[0.0, w], [-w, -2 * d * w]]), np.array([[0.0], [w]]), np.eye(2), np.zeros((2, 1))), DT
    )
    state, wanted = np.array([X[0], 0.0]), [[X[0], 0.0]]
    for x in X[1:]:
        state = a @ state + b[:, 0] * x
        wanted.append(c @ state)
    np.testing.assert_allclose(resonator(X, DT, 1.3, 0.2), wanted, atol=1e-9)


def test_a_delayed_series_is_its_own_past():
    np.testing.assert_allclose(delayed(X, T, 0.1)[25:], X[:-25], atol=1e-12)
    np.testing.assert_allclose(delayed(X, T, 0.1)[:25], X[0])


def test_the_series_of_laguerre_are_orthogonal_to_an_impulse():
    impulse = np.concatenate([[0.0], [1.0], np.zeros(4000)])
    series = laguerre(impulse, DT, 1.0, 5)
    gram = series.T @ series
    np.testing.assert_allclose(gram / gram[0, 0], np.eye(5), atol=1e-9)


def test_their_answers_are_the_fourier_transforms_of_their_impulses():
    impulse = np.concatenate([[0.0], [1.0], np.zeros(2**14 - 2)])
    hz = np.fft.rfftfreq(len(impulse), DT)[[3, 40, 400]]
    through = np.fft.rfft(laguerre(impulse, DT, 1.0, 4), axis=0)[[3, 40, 400]]
    moved = np.exp(2j * np.pi * hz * DT)[:, None]
    np.testing.assert_allclose(laguerre_answer(hz, DT, 1.0, 4), through * moved, atol=1e-9)
