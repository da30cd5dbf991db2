"""Shortcuts for robots of many joints and effects. Oracle: the same search without them, and a known truth."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.search import search as search_module
from identification.diagnosis.search import stepwise
from identification.diagnosis.search.search import dropped
from identification.diagnosis.search.stepwise import forward


@pytest.fixture(scope="module")
def made(lab, planar2):
    """Friction on both joints and an offset on one that the model lacks."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.7, 1.0] + np.array([0.4, 0.0])
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def steps(search) -> tuple[frozenset, int]:
    """What forward selection finds, and in how many steps."""
    told: list[str] = []
    return forward(search, frozenset(), told.append), len(told)


def test_effects_of_different_joints_join_in_one_step_and_are_the_same(made, monkeypatch):
    one_by_one, many = steps(made.search)
    monkeypatch.setattr(stepwise, "_MANY_JOINTS", 0)
    together, few = steps(made.search)
    assert together == one_by_one
    assert {term.joint for term in together} == {"shoulder", "elbow"}
    assert few < many


@pytest.mark.parametrize("tried", [1, 2])
def test_what_is_missed_least_is_what_a_fit_without_it_loses_least(made, monkeypatch, tried):
    needed = [("coulomb_friction", "shoulder"), ("coulomb_friction", "elbow"), ("torque_offset", "shoulder")]
    needless = [("viscous_friction", "shoulder"), ("cable_drag", "elbow"), ("torque_offset", "elbow")]
    known = {term.place for term in made.search.terms}
    chosen = frozenset(made.term(*place) for place in (*needed, *needless) if place in known)
    assert len(chosen) > 4
    monkeypatch.setattr(search_module, "_MOST_TRIED", tried)
    assert {term.place for term in dropped(made.search, chosen)} == set(needed)
