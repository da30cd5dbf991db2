"""Deviations of sizes beside other causes. Oracle: the law of total variance."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.terms import ordered
from identification.diagnosis.fit.joint_fit import joint_fit
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.findings.shown_numbers import with_other_causes
from identification.diagnosis.judge.judged_band import narrow_search
from identification.diagnosis.search.rival_sets import Standing


@pytest.fixture
def rubbing(lab, planar2):
    """Coulomb and viscous friction of the elbow are shown: sets of them by name, and what is shown."""
    motion = lab.motion(2, seconds=20.0)
    torque = lab.acting(planar2, motion, "coulomb_friction", "elbow", 0.5)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    coulomb, viscous = (prepared.term(name, "elbow") for name in ("coulomb_friction", "viscous_friction"))
    plain = narrow_search(prepared.search, prepared.noise)
    chosen = frozenset([coulomb])
    fit = joint_fit(plain.problem.of(chosen), ordered(chosen), plain.evaluate(chosen))
    return coulomb, frozenset([coulomb, viscous]), Shown(plain.of(chosen), chosen, fit, {}, chosen)


def test_a_size_is_uncertain_by_what_it_is_beside_a_likely_rival(rubbing):
    # Closed form: a variance of p (x' - x)^2 on top of its own.
    coulomb, both, shown = rubbing
    shown = replace(shown, standings={coulomb: Standing(0.7, (), elsewhere=((both, 0.3),))})
    column, at = coulomb.columns[0], shown.joint_fit.place(coulomb).coefficients.start
    shift = shown.plain.evaluate(both).theta[column] - shown.plain.evaluate(shown.chosen).theta[column]
    assert abs(shift) > 0.0
    more = with_other_causes(shown.joint_fit, shown).cov[at, at] - shown.joint_fit.cov[at, at]
    assert more == pytest.approx(0.3 * shift**2)


def test_a_set_that_is_a_rival_of_two_findings_counts_once(rubbing):
    # Closed form: the larger of its two probabilities.
    coulomb, both, shown = rubbing
    (viscous,) = both - {coulomb}
    once, twice = (
        replace(shown, standings={term: Standing(0.7, (), elsewhere=((both, p),)) for term, p in shares})
        for shares in (((coulomb, 0.3),), ((coulomb, 0.3), (viscous, 0.2)))
    )
    np.testing.assert_array_equal(*(with_other_causes(one.joint_fit, one).cov for one in (once, twice)))


def test_without_rivals_deviations_stay_as_they_are(rubbing):
    coulomb, _, shown = rubbing
    shown = replace(shown, standings={coulomb: Standing(1.0, ())})
    assert with_other_causes(shown.joint_fit, shown) is shown.joint_fit


def test_a_rival_that_has_not_the_effect_says_nothing_of_its_size(rubbing):
    coulomb, both, shown = rubbing
    shown = replace(shown, standings={coulomb: Standing(0.7, (), elsewhere=((both - {coulomb}, 0.3),))})
    np.testing.assert_array_equal(with_other_causes(shown.joint_fit, shown).cov, shown.joint_fit.cov)
