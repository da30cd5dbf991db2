from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from identification.estimators.consistent.consistent_bodies import (
    pseudo_inertia,
    reference_bodies,
    reference_body,
    standard_of,
)
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import body_parameters


def some_body(rng, principal):
    rotation = Rotation.random(rng=rng).as_matrix()
    return body_parameters(rng.uniform(0.5, 3), 0.3 * rng.normal(size=3), rotation @ np.diag(principal) @ rotation.T)


def test_the_pseudo_inertia_of_points_is_the_sum_of_their_outer_products(rng):
    # Oracle: its definition, and the inertia of points sum m (x.x 1 - x x^T).
    masses, points = rng.uniform(0.1, 1, 6), rng.normal(size=(6, 3))
    lifted = np.column_stack([points, np.ones(6)])
    center = masses @ points / masses.sum()
    away = points - center
    inertia = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, away, strict=True))
    given = pseudo_inertia(body_parameters(masses.sum(), center, inertia))
    np.testing.assert_allclose(given, lifted.T * masses @ lifted, atol=1e-12)


def test_parameters_come_back_from_their_pseudo_inertia(rng):
    standard = rng.normal(size=10)
    np.testing.assert_allclose(standard_of(pseudo_inertia(standard)), standard, atol=1e-15)


@pytest.mark.parametrize(("principal", "possible"), [((1, 2, 2.9), True), ((1, 2, 3.1), False), ((-0.1, 2, 2), False)])
def test_the_pseudo_inertia_is_positive_exactly_where_principal_inertias_are_possible(rng, principal, possible):
    # Oracle: positive principal inertias that keep the triangle inequality (Wittenburg).
    standard = some_body(rng, principal)
    assert (np.linalg.eigvalsh(pseudo_inertia(standard))[0] > 0) == possible


def test_a_possible_body_is_its_own_reference(rng):
    standard = some_body(rng, (0.1, 0.12, 0.13))
    np.testing.assert_array_equal(reference_body(standard).standard, standard)


@pytest.mark.parametrize("broken", [body_parameters(2.0, np.array([0.3, 0, 0]), np.zeros((3, 3))), np.zeros(10)])
def test_a_point_and_a_body_of_nothing_get_a_possible_reference(broken):
    reference = reference_body(broken)
    assert np.linalg.eigvalsh(pseudo_inertia(reference.standard / reference.scale))[0] > 0


def test_the_reference_has_no_distance_to_itself_and_a_share_of_it_has_that_share_twice(rng):
    # The square root of the trace of (P0^-1 dP)^2 is s sqrt(4) for dP = s P0.
    reference = reference_body(some_body(rng, (0.1, 0.12, 0.13)))
    step = 0.05 * reference.standard / reference.scale
    assert np.linalg.norm(reference.metric @ step) == pytest.approx(0.1)


def test_a_reference_that_is_not_finite_is_refused():
    with pytest.raises(ParameterError, match="reference body are not finite"):
        reference_bodies(np.full(10, np.nan))
