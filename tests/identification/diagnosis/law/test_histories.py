"""The oracle is each law stepped in small steps."""

import numpy as np

from identification.diagnosis.law.histories import bristle, slip

T = np.linspace(0.0, 20.0, 20001)
PATH = 0.4 * np.sin(1.1 * T) + 0.15 * np.sin(3.7 * T)


def test_a_bristle_follows_its_differential_equation():
    z = np.zeros(len(PATH))
    for k in range(1, len(PATH)):
        step = PATH[k] - PATH[k - 1]
        z[k] = z[k - 1] + step / 0.1 * (1.0 - z[k - 1] * np.sign(step))
    np.testing.assert_allclose(bristle(PATH, 0.1), z, atol=5e-3)


def test_a_slip_element_bends_until_it_slides():
    z = np.zeros(len(PATH))
    for k in range(1, len(PATH)):
        z[k] = np.clip(z[k - 1] + (PATH[k] - PATH[k - 1]) / 0.1, -1.0, 1.0)
    np.testing.assert_allclose(slip(PATH, 0.1), z, atol=1e-9)


def test_a_joint_that_stands_keeps_its_state():
    path = np.concatenate([np.linspace(0.0, 0.05, 50), np.full(50, 0.05), np.linspace(0.05, 0.06, 10)])
    z = slip(path, 0.1)
    np.testing.assert_allclose(z[50:100], 0.5)
    np.testing.assert_allclose(z[-1], 0.6)
