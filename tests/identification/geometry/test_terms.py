"""What may be wrong with a geometry. Oracle: the axes that the robot's file states."""

from __future__ import annotations

from dataclasses import replace

from identification.geometry.terms import ELASTIC, LINK, terms_of


def _parts(terms, joint):
    return [term.parameter for term in terms if term.joint == joint and term.effect == LINK]


def test_a_place_has_no_turn_about_the_joints_own_axis_as_that_is_its_zero(ur10):
    assert _parts(terms_of(ur10, ["tool0"]), "elbow_joint") == ["x", "y", "z", "rx", "rz"]  # it turns about y


def test_a_slide_along_none_of_its_own_axes_keeps_all_six_parts(arm):
    assert len(_parts(terms_of(arm, ["tool"]), "slide")) == 6


def test_joints_behind_the_frame_have_no_terms(ur10):
    joints = {term.joint for term in terms_of(ur10, ["forearm_link"])}
    assert joints == {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"}


def test_an_encoder_on_the_link_sees_the_elasticity_itself(ur10):
    on_link = replace(ur10, actuators=tuple(replace(one, encoder_side="link") for one in ur10.actuators))
    assert not [term for term in terms_of(on_link, ["tool0"]) if term.effect == ELASTIC]


def test_a_compliance_of_a_slide_is_in_metres_by_newton(arm):
    units = {term.unit for term in terms_of(arm, ["tool"]) if term.effect == ELASTIC and term.joint == "slide"}
    assert units == {"m/(N)"}
