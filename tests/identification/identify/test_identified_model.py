"""Which terms are unknowns."""

from __future__ import annotations

import numpy as np
import pytest

from identification.identify.identified_model import JointTerms, effects_of, friction_terms, without_estimated
from phantom_dyn.effects.support.changed_robot import with_rotor_inertia
from phantom_dyn.errors import UsageError


def test_terms_may_have_the_names_of_their_effects():
    assert friction_terms(["viscous_friction", "coulomb"]) == ("viscous", "coulomb")


def test_none_is_no_term():
    assert friction_terms(["none"]) == ()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["vicous"], "unknown term 'vicous', the terms are viscous, .*; did you mean viscous?"),
        (["coulomb", "coulomb_friction"], "names coulomb twice"),
        (["direction_dependent", "viscous"], "names viscous beside direction_dependent, which holds"),
        (["viscous", "none"], "unknown term 'none'|none beside"),
        ([""], "unknown term ''"),
    ],
)
def test_terms_that_make_no_sense_are_refused(words, sentence):
    with pytest.raises(UsageError, match=sentence):
        friction_terms(words)


def test_every_joint_gets_every_term(arm):
    effects = effects_of(arm, JointTerms(("viscous", "offset"), rotors=True))
    names = [(effect[0].name, effect[1]) for effect in effects]
    assert names[:3] == [("viscous_friction", "turn"), ("torque_offset", "turn"), ("rotor_inertia", "turn")]
    assert len(names) == 9


def test_only_what_is_an_unknown_is_taken_from_the_robot(arm):
    robot = without_estimated(arm, JointTerms(("viscous",)))
    assert not robot.viscous_friction.any()
    np.testing.assert_array_equal(robot.coulomb_friction, arm.coulomb_friction)


def test_friction_by_direction_replaces_both(arm):
    robot = without_estimated(arm, JointTerms(("direction_dependent",)))
    assert not robot.viscous_friction.any()
    assert not robot.coulomb_friction.any()


def test_rotors_stay_unless_they_are_unknowns(arm):
    heavy = with_rotor_inertia(arm, "tilt", 0.2)
    assert without_estimated(heavy, JointTerms(())).rotor_inertia[1] == 0.2
    assert not without_estimated(heavy, JointTerms((), rotors=True)).rotor_inertia.any()
