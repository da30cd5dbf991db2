"""What is visible above the noise. Oracle: squares that each set of effects leaves, made up by hand."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.gap import Sums
from identification.diagnosis.judge.findings import bench as bench_module
from identification.diagnosis.judge.findings.bench import Bench, State
from identification.diagnosis.judge.findings.shown import in_band


@pytest.fixture
def shown(quiet, monkeypatch):
    """Names of the effects that stay where each set of them leaves such squares on two joints."""
    friction, offset = quiet.term("coulomb_friction", "elbow"), quiet.term("torque_offset", "elbow")
    names = {friction: "f", offset: "o"}

    def kept(**left: tuple[float, float]) -> set[str]:
        counts = np.full((1, 2), 8.0)

        def squares(chosen: frozenset[Term]) -> Sums:
            square = np.array(left["".join(sorted(names[term] for term in chosen)) or "nothing"])
            return Sums(square * counts, counts)

        monkeypatch.setattr(bench_module, "squares_left", lambda plain, found: squares)
        monkeypatch.setattr(bench_module, "growth_of_gap", lambda problem, noise: 1.0)
        bench = Bench(quiet.search, quiet.search, quiet.noise, lambda _: pytest.fail("no floor is needed"))
        return {names[term] for term in in_band(bench, State.of(frozenset(names))).shown}

    return kept


@pytest.mark.parametrize(
    ("without", "kept"),
    [
        # Squares of one with both effects, and nine without friction.
        ((1.0, 1.029), {"f"}),
        ((1.0, 1.031), {"f", "o"}),
        ((1.031, 1.0), {"f", "o"}),
        # It costs one joint what it takes off the other.
        ((0.94, 1.05), {"f"}),
        ((0.96, 1.05), {"f", "o"}),
    ],
)
def test_an_effect_is_visible_that_helps_some_joint_by_three_per_cent_and_all_on_average(shown, without, kept):
    assert shown(fo=(1.0, 1.0), f=without, o=(9.0, 9.0), nothing=(9.0, 9.0)) == kept


def test_effects_are_judged_again_once_the_least_visible_is_gone(shown):
    # Without the offset friction takes off no more than two per cent; together each takes off a little.
    assert shown(fo=(1.0, 4.0), f=(1.01, 4.0), o=(1.02, 4.0), nothing=(1.03, 4.0)) == set()
    assert shown(fo=(1.0, 4.0), f=(1.01, 4.0), o=(1.02, 4.0), nothing=(1.05, 4.0)) == {"f"}
    assert shown(fo=(1.0, 4.0), f=(1.02, 4.0), o=(1.01, 4.0), nothing=(1.05, 4.0)) == {"o"}
