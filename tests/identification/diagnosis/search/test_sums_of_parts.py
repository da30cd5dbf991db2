"""A torque constant, and the sums of friction and load that make much the same torque."""

from dataclasses import replace

import numpy as np
import pytest

import phantom_dyn as dyn
from identification.diagnosis.fit.gap import RowGaps
from identification.diagnosis.search import stepwise
from identification.diagnosis.search.claims import passes_gates
from identification.diagnosis.search.containment import has_parts_in
from identification.diagnosis.search.swaps import alternatives, parts_of
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from places import ROBOTS
from sines import sines


def places(terms) -> set[tuple[str, str | None]]:
    return {term.effect_joint for term in terms}


def friction(*joints: str) -> set[tuple[str, str]]:
    return {(kind, joint) for kind in ("coulomb_friction", "viscous_friction") for joint in joints}


def test_parts_of_a_torque_constant_are_friction_of_its_joints_and_a_load(quiet):
    assert places(parts_of(quiet.search, quiet.term("torque_constant", "elbow"))) == {
        *friction("elbow"),
        ("payload", None),
    }
    assert parts_of(quiet.search, quiet.term("torque_offset", "elbow")) == []


def test_a_torque_constant_of_one_joint_is_compared_with_every_sum_of_its_parts(quiet):
    several = [places(group) for group in alternatives(quiet.search, quiet.term("torque_constant", "elbow"))]
    for group in (
        friction("elbow"),
        {("payload", None), ("viscous_friction", "elbow")},
        {("payload", None), *friction("elbow")},
    ):
        assert group in several


def test_a_torque_constant_of_several_joints_is_compared_with_friction_of_all_of_them(quiet):
    several = [places(group) for group in alternatives(quiet.search, quiet.term("torque_constant", "shoulder+elbow"))]
    assert [group for group in several if len(group) > 1] == [friction("shoulder", "elbow")]


def test_a_number_of_several_joints_does_not_replace_a_part_of_it_on_one_of_them(quiet):
    def with_both(name):
        one = quiet.term(name, "elbow")
        return {("torque_constant", "shoulder+elbow")} in map(places, alternatives(quiet.search, one))

    assert with_both("torque_constant")
    assert with_both("inertial_parameters")
    assert not with_both("coulomb_friction")


def test_which_numbers_of_several_joints_are_beside_parts_of_theirs(quiet):
    whole, single = (quiet.term("torque_constant", joint) for joint in ("shoulder+elbow", "elbow"))
    beside = frozenset([quiet.term("viscous_friction", "elbow")])
    assert has_parts_in(beside, whole)
    assert not has_parts_in(beside, single)
    assert not has_parts_in(frozenset([quiet.term("torque_offset", "elbow")]), whole)


def test_friction_too_small_to_be_claimed_counts_against_one_torque_constant_for_all(lab, arm):
    # Known truth: more friction on each joint, of which the viscous part gains less than chance on its own.
    motion = lab.motion(3, 4)
    more = -np.sign(motion.v) * [0.9, 0.7, 0.8] - motion.v * [0.004, 0.004, 0.004]
    prepared = lab.prepared(arm, (lab.recording(arm, motion, more),))
    whole = prepared.term("torque_constant", "+".join(arm.joint_names))
    dry = frozenset(prepared.term("coulomb_friction", joint) for joint in arm.joint_names)
    assert places(stepwise._with_small_parts(prepared.search, dry, whole)) == friction(*arm.joint_names)


@pytest.mark.parametrize(("scale", "found"), [(1.4, True), (1.0, False)])
def test_a_torque_constant_of_two_drives_is_added_to_friction_where_it_gains_more_than_friction_would(
    lab, arm, scale, found
):
    # Known truth: currents of two drives are read too large, or a joint has friction that is still to be found.
    motion = lab.motion(3, 4)
    recording = lab.recording(arm, motion, -np.sign(motion.v) * [0.9, 0.7, 0.8])
    prepared = lab.prepared(arm, (replace(recording, tau=recording.tau * [scale, scale, 1.0]),))
    whole = prepared.term("torque_constant", "+".join(arm.joint_names[:2]))
    several = arm.joint_names if found else arm.joint_names[1:]
    friction_found = frozenset(prepared.term("coulomb_friction", joint) for joint in several)
    assert stepwise._beats_small_parts(prepared.search, friction_found, whole) is found


@pytest.mark.parametrize(
    ("kinds", "joints", "causes"),
    [
        (("coulomb_friction",), ("shoulder", "elbow"), 1),
        (("coulomb_friction", "viscous_friction"), ("elbow",), 1),
        (("coulomb_friction", "viscous_friction"), ("shoulder", "elbow"), 2),
        (("coulomb_friction", "viscous_friction", "torque_offset"), ("shoulder", "elbow"), 2),
    ],
)
def test_effects_of_one_kind_or_on_one_joint_may_have_one_cause(quiet, kinds, joints, causes):
    # By hand: the smaller of the number of kinds and the number of joints.
    effects = frozenset(quiet.term(kind, joint) for kind in kinds for joint in joints)
    assert stepwise._count_of_causes(effects) == causes


@pytest.mark.parametrize(("causes", "margin", "accurate"), [(0, 1.0, 0), (1, 1.0, 1), (2, 0.0, 1), (3, -0.5, 0)])
def test_a_structure_for_one_or_two_causes_gains_more_than_their_laws_are_inaccurate(
    quiet, monkeypatch, causes, margin, accurate
):
    # By hand: so many thresholds of chance, and the inaccuracy.
    monkeypatch.setattr(stepwise, "_count_of_causes", lambda _: causes)
    asked = stepwise._least_nameless_gain(
        quiet.search, quiet.term("rhythm", "elbow"), frozenset(), 7.0, in_one_sine=False
    )
    assert asked == pytest.approx(margin * quiet.search.threshold.overall + 7.0 * accurate)


@pytest.mark.whole
def test_a_load_and_friction_of_a_pendulum_are_rivals_of_a_torque_constant():
    # Known truth: 0.6 kg and more friction, which scale weight, inertia and friction by nearly the same factor.
    pendulum = str(ROBOTS / "pendulum.urdf")
    load = ("payload", None, {"mass": 0.6, "center_x": 0.0, "center_y": 0.0, "center_z": -0.4})
    dry, viscous = ("coulomb_friction", "pin", {"torque": 0.2}), ("viscous_friction", "pin", {"coefficient": 0.2})
    motion = sines(np.arange(1501) / 100, 1, np.random.default_rng(1), size=0.5)
    made = dyn.simulate(pendulum, motion, effects=[load, dry, viscous])
    found = dyn.diagnose(pendulum, made.recording(position_noise=1e-5, torque_noise=0.05)).findings
    named = [places_of(found), *(places_of(rival.effects) for finding in found for rival in finding.rivals)]
    assert {("payload", None), *friction("pin")} in named
    assert all(finding.probability < 0.9 for finding in found if finding.effect == "torque_constant")


PAN_TILT = """<robot name="pan_tilt"><link name="base"/>
<link name="column"><inertial><mass value="3"/><origin xyz="0 0 0.2"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<link name="arm"><inertial><mass value="1.5"/><origin xyz="0.2 0 0"/>
  <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<joint name="pan" type="revolute"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="50" velocity="10"/></joint>
<joint name="tilt" type="revolute"><parent link="column"/><child link="arm"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="50" velocity="10"/></joint></robot>"""


@pytest.mark.whole
def test_rotors_of_two_joints_are_no_body_that_is_as_heavy_to_turn_about_every_axis(tmp_path):
    # Known truth: two rotors, whose torque the last link makes as well with an inertia that is the same about all axes.
    file = tmp_path / "pan_tilt.urdf"
    file.write_text(PAN_TILT)
    rotors = [("rotor_inertia", joint, {"inertia": 0.1}) for joint in ("pan", "tilt")]
    made = dyn.simulate(str(file), sines(np.arange(2001) / 100, 2, np.random.default_rng(1), size=0.5), effects=rotors)
    found = dyn.diagnose(str(file), made.recording(position_noise=1e-5, torque_noise=0.05)).findings
    assert places_of(found) == {("rotor_inertia", "pan"), ("rotor_inertia", "tilt")}
    rivals = [places_of(rival.effects) for finding in found for rival in finding.rivals]
    assert {("inertial_parameters", "tilt")} in rivals


def places_of(effects) -> set[tuple[str, str | None]]:
    return {(one.effect, one.joint) for one in effects}


def test_a_torque_constant_is_found_beside_much_friction_that_the_model_lacks(lab, planar2):
    # Known truth: 0.7 of the torque is asked for, and most of it is friction. Beside friction the constant explains
    # less than 1 % of the squared gap, and nearly all that friction leaves.
    motion = lab.motion(2, 5, seconds=20.0)
    needed = inverse_dynamics(planar2, motion)
    size = 6.0 * needed.std(axis=0)
    whole = 0.7 * (needed + size * (np.sign(motion.v) + motion.v))
    bare = lab.prepared(planar2, (lab.recording(planar2, motion, needed - whole, noise=0.01),)).search
    search = replace(bare, gaps=RowGaps(bare.fits.row_losses(frozenset()), np.zeros(2)))
    laws = frozenset(term for term in search.terms if term.effect_joint in friction("shoulder", "elbow"))
    scale = next(term for term in search.terms if term.effect_joint == ("torque_constant", "shoulder+elbow"))
    assert search.fits.row_losses(laws).sum() < 0.01 * search.gaps.gap.sum()
    assert passes_gates(search, laws | {scale}, laws)
    assert places(stepwise.stepwise_search(search, lambda _: None)) == places(laws | {scale})


def test_a_load_and_a_torque_constant_of_several_joints_are_found_together(lab, arm):
    # Known truth: a load of 0.7 kg, and two of three drives of which a quarter more torque is asked.
    motion = lab.motion(3, 5, seconds=20.0)
    needed = inverse_dynamics(arm, motion)
    loaded = needed - lab.acting(arm, motion, "payload", None, 0.7, 0.2, 0.05, -0.02)
    whole = loaded * np.array([1.0, 1.25, 1.25])
    prepared = lab.prepared(arm, (lab.recording(arm, motion, needed - whole, noise=0.01),))
    found = places(stepwise.stepwise_search(prepared.search, lambda _: None))
    assert found == {("payload", None), ("torque_constant", "+".join(arm.joint_names[1:]))}
