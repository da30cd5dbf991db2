"""What a diagnosis begins with: session, prepared columns, nuisances, common causes."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.columns.layout import (
    groups_by_drives,
    groups_by_place,
    groups_by_scales,
    groups_of_joints,
    scale_of_joints,
)
from identification.diagnosis.columns.prepared import prepared
from identification.diagnosis.columns.session import session_of
from identification.diagnosis.columns.terms import merged
from identification.diagnosis.columns.tolerance_parameters import parameters_by_joint, tolerance_parameters
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.result import EffectAt
from identification.diagnosis.search.containment import with_term
from identification.diagnosis.search.rival_sets import compare_with_rivals
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion


@pytest.fixture
def whole(lab, planar2) -> Recording:
    """Twenty seconds without a gap."""
    return lab.recording(planar2, lab.motion(2, 4, seconds=20.0))


def with_rows(recording: Recording, kept: np.ndarray) -> Recording:
    """Some samples of a recording."""
    assert recording.tau is not None
    return replace(recording, t=recording.t[kept], q=recording.q[kept], tau=recording.tau[kept])


def test_blocks_of_samples_shorter_than_the_filter_are_refused_with_both_lengths(whole, planar2):
    blocks = with_rows(whole, whole.t % 0.32 < 0.16)
    said = r"sim\.csv: gaps in time .* leave too few samples .* \(the longest stretch without lasts 0\.16 s, .* record"
    with pytest.raises(LogError, match=said):
        session_of(planar2, (blocks,))


def test_one_stretch_that_is_long_enough_is_used(whole, planar2):
    session = session_of(planar2, (with_rows(whole, (whole.t % 0.32 < 0.16) | (whole.t > 5.0)),))
    used = session.logs[0].motion.t[session.logs[0].samples[session.logs[0].valid_in_band]]
    assert len(used)
    assert used.min() > 5.0


def test_a_jump_at_an_end_of_a_log_is_no_speed_of_the_joint(whole, planar2):
    # Known truth: the speed of the same motion without the jump.
    q = whole.q.copy()
    q[0] += 0.1
    jumped, smooth = (session_of(planar2, (replace(whole, q=own),)) for own in (q, whole.q))
    np.testing.assert_allclose(jumped.largest_speed, smooth.largest_speed, rtol=1e-3)


@pytest.mark.parametrize(("last", "enough"), [(5.0, True), (8.0, False)])
def test_blocks_that_gaps_leave_no_sample_of_are_not_counted(lab, planar2, last, enough):
    # Of ten blocks of a second at least four have to be left, to be held out in turn.
    recording = replace(lab.recording(planar2, lab.motion(2, 1)), excluded=((0.0, last),))
    if enough:
        assert len(session_of(planar2, (recording,)).blocks) >= 4
    else:
        with pytest.raises(LogError, match=r"sim\.csv: gaps in time and excluded .* leave too few samples to"):
            session_of(planar2, (recording,))


def test_what_a_diagnosis_works_on_holds_nothing_of_a_long_recording(planar2):
    t = np.arange(0.0, 7200.0, 0.05)
    q = np.column_stack([np.sin(t), np.cos(t)])
    whole = Recording("long.csv", planar2.joint_names, t, q, np.ones_like(q))
    given = prepared(planar2, (whole,))
    assert len(given.fitted) == 15
    for part in given.fitted:
        assert not any(np.shares_memory(kept, raw) for kept, raw in ((part.t, t), (part.q, q), (part.tau, whole.tau)))
    assert given.files == ("long.csv",)
    assert "15 stretches" in given.notes[0]


@pytest.fixture(scope="module")
def arm():
    return load_robot("example:ur10")


def test_a_move_of_a_body_touches_the_joints_whose_torque_depends_on_it(arm, rng):
    # Oracle: Pinocchio's regressor at random states, which is zero where a body is not behind a joint.
    q, v, a = rng.normal(size=(3, 20, arm.nv))
    columns = rigid_body_regressor(arm, Motion(np.linspace(0.0, 1.0, 20), q, v, a))
    parameters, rows = tolerance_parameters(arm), parameters_by_joint(arm, tolerance_parameters(arm))
    bodies = {k: one.owner for k, one in enumerate(parameters) if isinstance(one.owner, int)}
    assert len(bodies) > arm.nv
    for k, body in bodies.items():
        first = 10 * (body - 1)
        felt = np.abs(columns[:, :, first : first + 10]).max(axis=(0, 2)) > 0
        assert [k in row for row in rows] == felt.tolist()


def test_a_shift_of_all_torques_in_time_touches_every_joint(arm):
    parameters = tolerance_parameters(arm)
    assert parameters[-1].kind == "timing"
    assert all(row[-1] == len(parameters) - 1 for row in parameters_by_joint(arm, parameters))


def test_runs_of_joints_in_the_order_of_their_scales_are_tried_together():
    # By hand: 0.9, 1.0 and 1.4, 1.4; a run from 0.9 to 1.4 differs by more than a factor of one and a half.
    runs = groups_by_scales(np.array([1.4, 0.9, 1.4, 1.0]))
    assert runs[0] == (0, 2)
    assert {tuple(sorted(run)) for run in runs} == {(0, 2), (1, 3), (0, 3), (0, 2, 3)}


def test_a_scale_is_found_beside_friction_and_an_offset(rng):
    t = np.linspace(0, 10, 2000)
    model, v = np.column_stack([np.sin(t), np.cos(2 * t)]), np.column_stack([np.cos(3 * t), np.sin(5 * t)])
    measured = model * [1.4, 0.8] + 0.5 * np.sign(v) + 0.2 * v + 0.1
    np.testing.assert_allclose(scale_of_joints(measured, model, v), [1.4, 0.8], atol=0.02)


def test_drives_of_one_kind_are_tried_together():
    groups = set(groups_by_drives(load_robot("example:ur5")))
    assert (0, 1, 2, 3, 4, 5) in groups
    # The UR5's three wrists have one torque limit and one stem of a name.
    assert (3, 4, 5) in groups


def test_joints_of_the_arm_and_of_the_wrist_are_tried_together():
    assert groups_by_place(4) == [(0, 1), (0, 1, 2), (2, 3), (1, 2, 3)]
    assert groups_by_place(2) == []


@pytest.fixture(scope="module")
def scaled(lab, planar2):
    """The planar arm whose torque readings are a fifth too small on both joints."""
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "torque_constant", "shoulder+elbow", 1.25)
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def test_both_joints_of_an_arm_may_have_one_scale(scaled):
    operation = merged(scaled.columns.operations)
    assert groups_of_joints(scaled.session, operation) == ("shoulder+elbow",)


def test_one_number_on_two_joints_is_found(scaled):
    # Known truth: 1.25 on both.
    term = next(t for t in scaled.columns.terms if t.effect_joint == ("torque_constant", "shoulder+elbow"))
    assert len(term.columns) == 1
    found = fit(scaled.problem, (term,))
    assert 1.0 / (1.0 + found.theta[term.columns[0]]) == pytest.approx(1.25, abs=0.01)


def test_a_joint_has_one_torque_constant(scaled):
    shared, single = (
        next(t for t in scaled.columns.terms if t.effect_joint == ("torque_constant", joint))
        for joint in ("shoulder+elbow", "elbow")
    )
    assert with_term(frozenset([single]), shared) == frozenset([shared])
    assert with_term(frozenset([shared]), single) == frozenset([single])


def test_one_scale_of_all_joints_is_not_looked_for_beside_bodies_that_are_all_free(scaled):
    # Closed form: with free bodies it changes nothing but the friction of the model.
    scale = next(t for t in scaled.columns.terms if t.effect_joint == ("torque_constant", "shoulder+elbow"))
    single = next(t for t in scaled.columns.terms if t.effect_joint == ("torque_constant", "elbow"))
    bodies = next(t for t in scaled.columns.terms if t.effect_joint == ("inertial_parameters", None))
    assert with_term(frozenset([scale]), bodies) == frozenset([bodies])
    assert with_term(frozenset([bodies]), scale) == frozenset([scale])
    assert with_term(frozenset([single]), bodies) == frozenset([single, bodies])


def test_bodies_of_all_links_are_as_likely_as_one_scale_of_all_joints_beside_friction(lab, planar2):
    # Closed form: torques that are 1.25 times the readings, with friction on both joints that the model lacks.
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "torque_constant", "shoulder+elbow", 1.25) - 0.4 * np.sign(motion.v)
    search = lab.prepared(planar2, (lab.recording(planar2, motion, torque),)).search
    places = [("torque_constant", "shoulder+elbow"), *(("coulomb_friction", joint) for joint in ("shoulder", "elbow"))]
    chosen = frozenset(next(t for t in search.terms if t.effect_joint == place) for place in places)
    scale = next(t for t in chosen if t.effect.shared)
    comparison = compare_with_rivals(search, chosen, scale)
    shares = {rival.effects: rival.probability for rival in comparison.rivals}
    assert shares[(EffectAt("inertial_parameters", None),)] == pytest.approx(comparison.probability)
    # As many causes either way: what has fewer numbers leads.
    assert comparison.leading_set is None
