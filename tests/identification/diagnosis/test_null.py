from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fitting import fit
from identification.diagnosis.null import null_threshold
from identification.diagnosis.search import PARAMETER_PRICE, price

FRICTION = ("viscous_friction", "coulomb_friction", "torque_offset")


def gains(prepared) -> np.ndarray:
    """What each rival gains on held-out data, less what it has to pay beyond one parameter."""
    search = prepared.search
    base = fit(prepared.problem, ()).total
    return np.array(
        [
            base - fit(prepared.problem, (term,)).total - max(price(search.sizes[term]) - PARAMETER_PRICE, 0.0)
            for term in search.terms
        ]
    )


def test_the_threshold_is_the_same_on_every_call(quiet):
    assert null_threshold(quiet.search, quiet.noise) == null_threshold(quiet.search, quiet.noise)


def test_no_effect_gains_the_threshold_where_there_is_no_gap(lab, planar2):
    # Known truth: recordings without a gap; each exceeds the quantile in one of a hundred.
    for seed in range(4):
        prepared = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seed), seed=seed),))
        assert gains(prepared).max() < null_threshold(prepared.search, prepared.noise).overall


def test_an_effect_gains_more_than_the_threshold(lab, planar2):
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -np.sign(motion.v) * [0.0, 0.3]),))
    assert gains(prepared).max() > 3 * null_threshold(prepared.search, prepared.noise).overall


def test_twice_the_noise_of_a_trusted_model_gains_four_times_as_much_by_chance(lab, planar2, trusted):
    # Gains are quadratic in the noise where nothing else is drawn; prices are not, so the rivals are those of one
    # parameter. The timing of the torque has a prior of its own: rivals that look like it are left out.
    robot = trusted(planar2)
    prepared = lab.prepared(robot, (lab.recording(robot, lab.motion(2)),))
    search = prepared.search
    search = replace(search, terms=tuple(term for term in search.terms if term.effect.name in FRICTION))
    once = null_threshold(search, prepared.noise).overall
    twice = null_threshold(search, tuple(2 * part for part in prepared.noise)).overall
    assert twice == pytest.approx(4 * once, rel=1e-2)


def test_more_rivals_gain_more_by_chance(quiet):
    few = replace(quiet.search, terms=quiet.search.terms[:2])
    assert null_threshold(few, quiet.noise).overall < null_threshold(quiet.search, quiet.noise).overall
