"""Shortcuts for robots of many joints and effects. Oracle: the same search without them, and a known truth."""

import numpy as np
import pytest

from identification.diagnosis.search import claims, swaps
from identification.diagnosis.search import search as search_module
from identification.diagnosis.search.claims import dropped
from identification.diagnosis.search.stepwise import forward
from identification.diagnosis.search.swaps import swapped


@pytest.fixture(scope="module")
def made(lab, planar2):
    """Friction on both joints and an offset on one that the model lacks."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.7, 1.0] + np.array([0.4, 0.0])
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def steps(search) -> tuple[frozenset, int]:
    """What forward selection finds, and in how many steps."""
    said: list[str] = []
    return forward(search, frozenset(), said.append), len(said)


def test_effects_of_different_joints_join_in_one_step_and_are_the_same(made, monkeypatch):
    one_by_one, many = steps(made.search)
    monkeypatch.setattr(search_module, "_MANY_JOINTS", 0)
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
    monkeypatch.setattr(claims, "_MOST_TRIED", tried)
    assert {term.place for term in dropped(made.search, chosen)} == set(needed)


@pytest.fixture
def passes(monkeypatch) -> list[int]:
    """How many effects there are at each pass of elimination."""
    seen: list[int] = []
    plain = claims.least_missed
    monkeypatch.setattr(claims, "least_missed", lambda *given: seen.append(len(given[1])) or plain(*given))
    return seen


def test_needless_effects_of_different_joints_go_in_one_pass_and_are_the_same(made, monkeypatch, passes):
    needed = [("coulomb_friction", "shoulder"), ("coulomb_friction", "elbow"), ("torque_offset", "shoulder")]
    needless = [("viscous_friction", "shoulder"), ("torque_offset", "elbow")]
    chosen = frozenset(made.term(*place) for place in (*needed, *needless))
    one_by_one = dropped(made.search, chosen)
    assert passes == [5, 4, 3]
    passes.clear()
    monkeypatch.setattr(search_module, "_MANY_JOINTS", 0)
    assert dropped(made.search, chosen) == one_by_one
    assert passes == [5, 3]


def test_effects_of_different_joints_are_swapped_in_one_pass_and_are_the_same(made, monkeypatch):
    wrong = frozenset(made.term("viscous_friction", joint) for joint in ("shoulder", "elbow"))
    chosen = wrong | {made.term("torque_offset", "shoulder")}
    tried: list[frozenset] = []
    monkeypatch.setattr(swaps, "dropped", lambda search, some: tried.append(some) or dropped(search, some))
    one_by_one = swapped(made.search, chosen)
    assert len(tried) == 2
    tried.clear()
    monkeypatch.setattr(search_module, "_MANY_JOINTS", 0)
    assert swapped(made.search, chosen) == one_by_one
    assert len(tried) == 1
    assert {term.place for term in one_by_one} >= {("coulomb_friction", "shoulder"), ("coulomb_friction", "elbow")}
