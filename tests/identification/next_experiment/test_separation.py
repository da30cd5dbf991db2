from __future__ import annotations

import numpy as np

from identification.diagnosis.result import EffectAt
from identification.next_experiment.hypotheses import Hypothesis, Model
from identification.next_experiment.separation import Pair, Rivalry, separation


class Simple(Hypothesis):
    """Contains nothing."""

    def contains(self, other):
        return False


class Rich(Hypothesis):
    """Contains the other one."""

    def contains(self, other):
        return True


def law(columns: tuple[int, ...], theta: list[float]) -> Model:
    """A fit of some columns of all, without moves of the model."""
    basis = np.eye(len(theta))[:, list(columns)]
    bound = np.full(len(columns), np.inf)
    return Model(
        np.array(theta), basis, np.zeros(len(theta)), np.full(len(columns), 1e-6), -bound, bound,
        np.zeros(len(columns), dtype=bool), 0.0, columns,
    )  # fmt: skip


def test_a_richer_law_is_struck_off_no_more_surely_than_its_least_visible_shape(rng):
    # The simple law's column, one of a shape that differs from it, and one of a shape that hardly does. The simple law
    # is nearly certain, so that the power is that of striking off the other.
    simple, seen, hidden = (law((k,), theta) for k, theta in enumerate(2.0 * np.eye(3)))
    one = Simple((EffectAt("coulomb_friction", "pin"),), 1.0, ())
    other = Rich((EffectAt("presliding_friction", "pin"),), 0.0, ())

    def power(*shapes):
        same, own = rng.standard_normal((2, 4000))
        columns = np.stack([same, own, same + 0.001 * own], axis=1)
        rivalry = Rivalry(
            (Pair(one, other),), {one.effects: (simple,), other.effects: shapes}, columns.T @ columns, 1.0, 0
        )
        return separation(rivalry, 100.0 * columns.T @ columns).power[0]

    assert power(seen) > 0.9
    assert power(hidden) < 0.05
    assert power(seen, hidden) < 0.05
