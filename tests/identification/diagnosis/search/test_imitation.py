"""Effects that imitate a finding where joints move along one line. Oracle: joints whose load never changes."""

import numpy as np
import pytest

from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.imitation import along_lines, beside_imitation, imitated_by, on_a_line
from identification.diagnosis.search.rival_sets import Standing
from phantom_dyn.motion import Motion


@pytest.fixture(scope="module")
def in_line(lab, planar2):
    """Both joints follow one slow sine of some degrees; the elbow rubs with 0.5 N m more than modelled."""
    t = np.arange(0.0, 30.0, 0.002)
    q = np.column_stack([0.06 * np.sin(2 * t) + 0.9, 0.03 * np.sin(2 * t) + 0.3])
    v, a = (np.column_stack([s * f for s in (0.06, 0.03)]) for f in (2 * np.cos(2 * t), -4 * np.sin(2 * t)))
    motion = Motion(t, q, v, a)
    torque = lab.acting(planar2, motion, "coulomb_friction", "elbow", 0.5)
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def term(prepared, name, joint):
    return next(t for t in prepared.search.terms if t.place == (name, joint))


def test_both_joints_are_along_a_line(in_line):
    assert along_lines(in_line.session) == {0, 1}


def test_a_load_that_hardly_changes_makes_friction_under_load_of_coulomb_friction(in_line):
    rubs = term(in_line, "coulomb_friction", "elbow")
    found = imitated_by(in_line.search, frozenset([rubs]), rubs)
    assert found is not None
    assert "load_dependent_friction" in {one.effect.name for one in found}


def test_friction_is_not_imitated_where_joints_move_freely(lab, planar2):
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "coulomb_friction", "elbow", 0.5)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    assert along_lines(prepared.session) == frozenset()
    rubs = term(prepared, "coulomb_friction", "elbow")
    assert imitated_by(prepared.search, frozenset([rubs]), rubs) is None


def test_an_imitation_is_as_likely_as_what_it_imitates(in_line):
    known = Rival((EffectAt("stribeck_friction", "elbow"),), 0.1)
    loaded = term(in_line, "load_dependent_friction", "elbow")
    found = beside_imitation(Standing(0.9, (known,)), (loaded,))
    assert found.probability == 0.45
    assert found.rivals == (Rival((EffectAt("load_dependent_friction", "elbow"),), 0.45), known)
    assert beside_imitation(Standing(0.9, (known,)), None) == Standing(0.9, (known,))


@pytest.mark.parametrize(
    ("name", "joint", "most"),
    [("payload", None, 0.85), ("torque_constant", "elbow", 0.85), ("viscous_friction", "elbow", 0.99)],
)
def test_no_load_and_no_torque_scale_is_certain_along_a_line_and_friction_is(in_line, name, joint, most):
    assert on_a_line(Standing(0.99, ()), term(in_line, name, joint)).probability == most
    assert on_a_line(Standing(0.5, ()), term(in_line, name, joint)).probability == 0.5
