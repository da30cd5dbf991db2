# pyright: reportAttributeAccessIssue=false
"""What gave way to rivals is asked again where one of these falls. Oracle: the sets, written by hand.

Intervals of bodies on the edge of what can exist. Oracles: the edge itself, and a body well inside of it.

What a voltage shows of a drive. Known truth: constants and friction of a simulated motor, in closed form.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import phantom_dyn as dyn
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.full_fit import full_fit
from identification.diagnosis.judge.findings import shown as shown_module
from identification.diagnosis.judge.findings.findings import one_sided_notes
from identification.diagnosis.judge.findings.gate_state import LoopState, ShownEffects
from identification.diagnosis.judge.findings.shown import (
    _with_exchanges_undone,
    shown_effects,
    with_equal_probabilities,
    with_replacements,
)
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.gates.rivalry import likelier_than_rivals
from identification.notes import Code
from identification.pipeline import diagnose
from identification.words.note_words import sentences
from identification.words.notes_on_findings import FINDING_WORDS
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion


@pytest.fixture
def rubbing(lab, planar2):
    """Friction on the elbow that the model lacks, and the search that may say so."""
    motion = lab.motion(2, seconds=20.0)
    torque = lab.acting(planar2, motion, "coulomb_friction", "elbow", 0.5)
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


@pytest.fixture
def all_sure(monkeypatch):
    """Every effect closes for sure, so that the other gates decide."""
    monkeypatch.setattr(shown_module, "least_shares_closed", lambda left, chosen, floor: dict.fromkeys(chosen, 1.0))


def test_what_is_not_distinguished_from_zero_is_no_finding(context_of, rubbing, all_sure):
    # Known truth: friction on the elbow, and no offset.
    context, offset = context_of(rubbing), rubbing.term("torque_offset", "elbow")
    friction = rubbing.term("coulomb_friction", "elbow")
    shown = shown_effects(context, LoopState.of(frozenset([friction, offset])))
    assert shown.chosen == {friction}
    assert [slices.term for slices in shown.full_fit.term_slices] == [friction]
    results = {result.gate: result for result in context.record.results_of(offset.effect_joint)}
    assert not results["differs from simpler"].passed


def test_a_torque_constant_of_one_is_no_finding(context_of, rubbing, all_sure):
    # Known truth: the torque constants are right; by the contract a ratio differs from one by two deviations.
    friction, ratio = rubbing.term("coulomb_friction", "elbow"), rubbing.term("torque_constant", "elbow")
    assert shown_effects(context_of(rubbing), LoopState.of(frozenset([friction, ratio]))).chosen == {friction}


def test_the_search_for_a_leader_ends_where_every_set_names_another_one(context_of, rubbing, monkeypatch):
    # By hand: each of the first sets has the next term lead in its place; the rival of the third is ahead by least.
    terms = tuple({term.effect_joint: term for term in rubbing.search.terms if term.named}.values())
    asked: list[Term] = []

    def next_leads(search, chosen, term, *_):
        asked.append(term)
        following = terms[terms.index(term) + 1]
        ahead = 0.1 if len(asked) == 3 else 0.4
        rival = Rival(effects=(EffectAt(*following.effect_joint),), probability=0.3 + ahead)
        return RivalComparison(
            0.3, (rival,), frozenset([following]), (likelier_than_rivals(0.3, 0.3 + ahead, leads=False),)
        )

    monkeypatch.setattr(shown_module, "compare_with_rivals", next_leads)
    monkeypatch.setattr(shown_module, "weighed_with_structures", lambda search, found, term, comparison, _: comparison)
    for step in ("_motion_gate", "_closing_gate", "_noise_gate", "_simpler_law_gate", "_missing_part_gate"):
        monkeypatch.setattr(shown_module, step, lambda context, state: state)
    context = context_of(rubbing)
    shown = shown_effects(context, LoopState.of(frozenset(terms[:1])))
    assert len(asked) == 8
    assert shown.chosen == {terms[2]}
    assert shown.comparisons[terms[2]].probability == pytest.approx(0.35)
    # What was looked at last had to give way to it.
    assert context.record.replacements_of(terms[7].effect_joint) == (terms[2].effect_joint,)


@pytest.mark.parametrize(("of_rival", "in_its_place"), [(0.5, True), (-0.5, False)])
def test_a_rival_that_closes_the_gap_for_sure_takes_the_place_of_an_effect_that_does_not(
    context_of, rubbing, monkeypatch, of_rival, in_its_place
):
    # By hand: viscous friction opens the gap in some draws; Coulomb friction, its rival, does so or does not.
    viscous, coulomb = (rubbing.term(name, "elbow") for name in ("viscous_friction", "coulomb_friction"))
    least = {viscous: -0.5, coulomb: of_rival}
    monkeypatch.setattr(shown_module, "least_shares_closed", lambda _, chosen, __: {one: least[one] for one in chosen})
    elsewhere = ((frozenset([coulomb]), 0.4),)
    monkeypatch.setattr(shown_module, "compare_with_rivals", lambda *_: RivalComparison(0.6, (), rival_sets=elsewhere))
    context = context_of(rubbing)
    after = shown_module._closing_gate(context, LoopState.of(frozenset([viscous])))
    assert after.shown == (elsewhere[0][0] if in_its_place else frozenset())
    assert context.record.replacements_of(viscous.effect_joint) == ((coulomb.effect_joint,) if in_its_place else ())


def test_no_rival_is_looked_for_in_place_of_an_effect_that_closes_nothing(context_of, rubbing, monkeypatch):
    # By hand: what closes nothing of the gap may as well be noise.
    viscous = rubbing.term("viscous_friction", "elbow")
    monkeypatch.setattr(shown_module, "least_shares_closed", lambda left, chosen, floor: dict.fromkeys(chosen, -1.0))
    monkeypatch.setattr(shown_module, "compare_with_rivals", lambda *_: pytest.fail("a rival was looked for"))
    assert not shown_module._closing_gate(context_of(rubbing), LoopState.of(frozenset([viscous]))).shown


def test_what_closes_the_gap_only_beside_a_structure_without_a_name_is_not_shown(context_of, rubbing, monkeypatch):
    # By hand: friction closes the gap beside the structure, and enlarges it alone, as in the corrected model.
    viscous = rubbing.term("viscous_friction", "elbow")
    structure = next(term for term in rubbing.search.terms if not term.named)
    by_set = {frozenset([viscous, structure]): 0.5, frozenset([viscous]): -1.0}
    monkeypatch.setattr(
        shown_module, "least_shares_closed", lambda left, chosen, floor: dict.fromkeys(chosen, by_set.get(chosen, 0.5))
    )
    after = shown_module._closing_gate(context_of(rubbing), LoopState.of(frozenset([viscous, structure])))
    assert after.shown == {structure}


def test_stribeck_friction_of_equal_levels_is_named_coulomb_friction(context_of, rubbing):
    # Known truth: Coulomb friction alone; what was found in its place changes its name.
    stribeck, coulomb = rubbing.term("stribeck_friction", "elbow"), rubbing.term("coulomb_friction", "elbow")
    context = context_of(rubbing)
    assert shown_effects(context, LoopState.of(frozenset([stribeck]))).chosen == {coulomb}
    assert context.record.replacements_of(stribeck.effect_joint) == (coulomb.effect_joint,)


def test_a_simpler_law_is_named_where_a_richer_one_is_better_by_less_than_the_method_is_accurate_to(lab, pendulum):
    # Known truth: friction of five hundred times the noise, greater by one per cent in one direction.
    robot = replace(pendulum, coulomb_friction=np.zeros(1), viscous_friction=np.zeros(1))
    motion = lab.motion(1, 3, seconds=20.0)
    torque = lab.acting(robot, motion, "coulomb_friction", "pin", 5.0) * np.where(motion.v > 0, 1.01, 1.0)
    found = diagnose(robot, (lab.recording(robot, motion, torque, noise=0.01),)).findings
    assert [(finding.effect, finding.rivals) for finding in found] == [("coulomb_friction", ())]


def test_an_effect_that_is_the_whole_gap_closes_all_of_it_however_small_the_gap(lab, pendulum, trusted):
    # Known truth: an offset as large as the noise in the judged band is all that a trusted model lacks.
    robot, motion = trusted(pendulum), lab.motion(1, 3, seconds=20.0)
    found = diagnose(robot, (lab.recording(robot, motion, 0.0095),))
    assert found.joints[0].rms_before < 1.6 * found.joints[0].noise_floor
    assert [finding.effect for finding in found.findings] == ["torque_offset"]
    assert found.findings[0].gap_closed == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("own", "rivals", "even"),
    [
        (0.3, (0.5, 0.2), (0.4, 0.4, 0.2)),
        (0.2, (0.5, 0.3), (0.35, 0.35, 0.3)),
        (0.1, (0.5, 0.4), (1.0 / 3, 1.0 / 3, 1.0 / 3)),
        (0.5, (0.4, 0.1), (0.5, 0.4, 0.1)),
    ],
)
def test_a_finding_and_the_rivals_that_outdo_it_share_what_they_have(own, rivals, even):
    # By hand: those above the mean of all before them join it.
    named = tuple(Rival((EffectAt(f"law_{k}", "j1"),), share) for k, share in enumerate(rivals))
    out = with_equal_probabilities(RivalComparison(own, named, frozenset()))
    shown = (out.probability, *(rival.probability for rival in out.rivals))
    assert shown == pytest.approx(even)


def test_a_finding_that_leads_keeps_its_share():
    rival = Rival((EffectAt("viscous_friction", "j1"),), 0.4)
    assert with_equal_probabilities(RivalComparison(0.6, (rival,))) == RivalComparison(0.6, (rival,))


def test_a_rival_that_cannot_lead_is_no_more_probable_than_the_finding():
    # By hand: no set is given that has the rival in the place of the finding.
    out = with_equal_probabilities(RivalComparison(0.2, (Rival((EffectAt("actuator_lag", "j1"),), 0.6),)))
    assert (out.probability, out.rivals[0].probability) == pytest.approx((0.4, 0.4))


@dataclass(frozen=True)
class Named:
    """What a set of effects asks of one."""

    name: str
    joint: str | None

    @property
    def effect_joint(self) -> tuple[str, str | None]:
        return self.name, self.joint


@pytest.mark.parametrize(
    ("replacements", "displaced", "expected"),
    [
        # By hand: one change on each joint at once; the second on a joint waits, one of the whole robot stands alone.
        ([("coulomb", "viscous", "elbow"), ("offset", "spring", "shoulder")], (), {"viscous", "spring"}),
        ([("coulomb", "viscous", "elbow"), ("offset", "spring", "elbow")], (), {"viscous", "offset"}),
        ([("coulomb", "viscous", "elbow"), ("offset", "tilt", None)], (), {"viscous", "offset"}),
        ([("offset", "tilt", None), ("coulomb", "viscous", "elbow")], (), {"coulomb", "tilt"}),
        ([("coulomb", "viscous", "elbow")], (("viscous", "elbow"),), {"coulomb", "offset"}),
    ],
)
def test_rivals_on_different_joints_take_their_places_at_once(replacements, displaced, expected):
    gone = {old: joint or "elbow" for old, _, joint in replacements}
    chosen = frozenset(Named(name, gone.get(name, "elbow")) for name in ("coulomb", "offset"))
    sets = [
        frozenset(one for one in chosen if one.name != old) | {Named(new, joint)} for old, new, joint in replacements
    ]
    assert {one.name for one in with_replacements(chosen, sets, set(displaced))} == expected


@pytest.fixture
def place(quiet):
    """A term of the planar arm by effect and joint."""
    return lambda effect, joint: next(
        term for term in quiet.search.terms if (term.effect.name, term.joint) == (effect, joint)
    )


@pytest.fixture
def exchanged(place, quiet):
    """Viscous friction gave way to a coupling and a spring together."""
    gone = frozenset([place("viscous_friction", "elbow")])
    rivals = frozenset([place("joint_coupling", "shoulder+elbow"), place("parasitic_spring", "elbow")])
    state = LoopState(
        rivals, rivals, displaced=frozenset(term.effect_joint for term in gone), exchanges=((gone, rivals),)
    )
    return SimpleNamespace(record=quiet.search.record.copy_for_trial()), state, gone, rivals


def test_it_is_back_where_one_of_the_rivals_falls(exchanged):
    context, before, gone, rivals = exchanged
    fallen = min(rivals, key=lambda term: term.effect.name)
    after = _with_exchanges_undone(context, before, replace(before, shown=rivals - {fallen}))
    assert (after.found, after.shown) == (gone, gone)
    assert after.barred == {fallen.effect_joint}
    assert after.displaced == frozenset()


def test_it_stays_away_while_all_of_them_are_there(exchanged):
    context, before, _, _ = exchanged
    assert _with_exchanges_undone(context, before, before) is before


def test_it_stays_away_where_something_simpler_takes_the_place(exchanged, place):
    context, before, _, rivals = exchanged
    simpler = frozenset([place("torque_offset", "elbow")])
    after = replace(before, shown=(rivals - {place("parasitic_spring", "elbow")}) | simpler)
    assert _with_exchanges_undone(context, before, after) is after


@pytest.mark.parametrize(("spring", "offset", "back"), [(0.6, 0.1, True), (0.4, 0.5, False)])
def test_it_is_back_beside_the_only_rival_that_falls_if_no_other_is_likelier(exchanged, place, spring, offset, back):
    context, before, gone, _ = exchanged
    rival = frozenset([place("parasitic_spring", "elbow")])
    likelier = (
        Rival((EffectAt("parasitic_spring", "elbow"),), spring),
        Rival((EffectAt("torque_offset", "elbow"),), offset),
    )
    comparison = RivalComparison(1.0 - spring - offset, likelier)
    shown = ShownEffects(None, gone, None, dict.fromkeys(gone, comparison))
    # What fails to be shown by motion is hidden, and still found.
    before = replace(before, found=rival, shown=rival, exchanges=((gone, rival),), compared_sets=(shown,))
    after = _with_exchanges_undone(context, before, replace(before, shown=frozenset()))
    assert after.shown == (gone if back else frozenset())
    assert after.barred == frozenset()
    # It may not take the place of what is back once more.
    assert ({term.effect_joint for term in rival} <= after.displaced) is back


def shown_on(lab, robot, torque_of) -> ShownEffects:
    """Inertial parameters of the elbow, found in a recording with a torque beyond the model."""
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    prepared = lab.prepared(robot, (lab.recording(robot, motion, torque_of(motion)),))
    term = next(t for t in prepared.columns.terms if t.effect_joint == ("inertial_parameters", "elbow"))
    found = fit(prepared.problem, (term,))
    fitted = full_fit(prepared.problem, (term,), found)
    return cast(ShownEffects, SimpleNamespace(problem=prepared.problem, full_fit=fitted, named=frozenset([term])))


def test_a_body_on_the_edge_has_an_interval_to_one_side(lab, planar2):
    inertia = float(planar2.model.inertias[2].toDynamicParameters()[6])
    # More inertia is missing than the elbow has.
    shown = shown_on(lab, planar2, lambda motion: 30.0 * inertia * motion.a * [0.0, 1.0])
    (note,) = one_sided_notes(shown)
    assert note.joint == "elbow"
    (moment,) = [part for part in note.numbers["intervals"] if part[0] == "elbow.Iyy"]
    # No link has less than no inertia.
    assert -inertia <= moment[1] < moment[2]
    assert "in one direction only" in FINDING_WORDS[note.code](note)


def test_a_heavier_link_that_exists_has_none(lab, planar2):
    def heavier(motion):
        return lab.acting(planar2, motion, "payload", None, 0.3, 0.1, 0.0, -0.2)

    assert one_sided_notes(shown_on(lab, planar2, heavier)) == ()


# Torque constant [N m/A], resistance [Ohm] and viscous friction [N m s/rad] of the motor.
CONSTANT, RESISTANCE, VISCOUS = 1.0, 1.25, 0.3
TRUE_SUM = CONSTANT**2 / RESISTANCE + VISCOUS

URDF = """<robot name="lever"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.15"/><mass value="0.8"/>
<inertia ixx="0.003" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.0005"/></inertial></link>
<joint name="servo" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.mark.parametrize("factor", [1.0, 1.2])
def test_the_sum_does_not_depend_on_the_stated_constants(tmp_path, rng, factor):
    # The same torque per volt from another constant and resistance: back-EMF and friction change places.
    (tmp_path / "lever.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(
        f"joints: {{servo: {{torque_constant: {factor * CONSTANT}, resistance: {factor * RESISTANCE}}}}}\n"
    )
    robot = dyn.load_robot(tmp_path / "lever.urdf")
    t, w = np.arange(0, 20.0, 0.01), 2 * np.pi * np.array([0.23, 0.61, 0.97])
    q, v, a = (
        (0.5 * x).sum(axis=1)[:, None]
        for x in (np.sin(t[:, None] * w), w * np.cos(t[:, None] * w), -(w**2) * np.sin(t[:, None] * w))
    )
    torque = inverse_dynamics(robot, Motion(t, q, v, a)) + VISCOUS * v
    volts = (torque + CONSTANT**2 / RESISTANCE * v) * RESISTANCE / CONSTANT + 0.02 * rng.standard_normal(v.shape)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack([t[:, None], q, volts]), delimiter=",", header="t,q.servo,u.servo", comments="")
    found = dyn.diagnose(robot, str(path))
    (note,) = [one for one in found.result.notes if not isinstance(one, str) and one.code is Code.DRIVE_SUM]
    assert note.joint == "servo"
    assert abs(note.numbers["sum"] - TRUE_SUM) < 3 * note.numbers["std"] + 0.003
    assert note.numbers["back_emf"] == pytest.approx(factor * CONSTANT**2 / RESISTANCE)


def test_a_torque_has_no_such_sum(tmp_path):
    robot = dyn.load_robot("example:double_pendulum")
    t = np.arange(0, 20.0, 0.01)
    w = 2 * np.pi * np.array([0.23, 0.41])
    q, v, a = (0.6 * x for x in (np.sin(t[:, None] * w), w * np.cos(t[:, None] * w), -(w**2) * np.sin(t[:, None] * w)))
    torque = inverse_dynamics(robot, Motion(t, q, v, a)) + 0.3 * v
    names = ",".join(f"{kind}.{joint}" for kind in ("q", "tau") for joint in robot.joint_names)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack([t[:, None], q, torque]), delimiter=",", header=f"t,{names}", comments="")
    found = dyn.diagnose(robot, str(path))
    assert {one.effect for one in found.findings} == {"viscous_friction"}
    assert not [one for one in found.result.notes if not isinstance(one, str) and one.code is Code.DRIVE_SUM]


@pytest.mark.parametrize(("called", "noted"), [("volts", True), ("torque", False)])
def test_volts_that_are_called_torque_get_a_note(tmp_path, rng, called, noted):
    # Closed form: u = R / k tau + k v. A torque with friction alone gets none.
    (tmp_path / "lever.urdf").write_text(URDF)
    robot = dyn.load_robot(tmp_path / "lever.urdf")
    t, w = np.arange(0, 20.0, 0.01), 2 * np.pi * np.array([0.23, 0.61, 0.97])
    q, v, a = (
        (0.5 * x).sum(axis=1)[:, None]
        for x in (np.sin(t[:, None] * w), w * np.cos(t[:, None] * w), -(w**2) * np.sin(t[:, None] * w))
    )
    needed = inverse_dynamics(robot, Motion(t, q, v, a))
    tau = 1.8 * needed + 0.3 * v if called == "volts" else needed + 0.3 * v
    tau = tau + 0.002 * rng.standard_normal(v.shape)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack([t[:, None], q, tau]), delimiter=",", header="t,q.servo,tau.servo", comments="")
    found = dyn.diagnose(robot, str(path))
    notes = [one for one in found.result.notes if not isinstance(one, str) and one.code is Code.PERHAPS_VOLTS]
    assert [one.numbers["joints"] for one in notes] == ([["servo"]] if noted else [])
    # What is said to be found is among the findings: on one joint a load looks like the constant, which is a rival.
    constants = {one.joint for one in found.findings if one.effect == "torque_constant"}
    assert all(("found together" in said) == ("servo" in constants) for said in sentences(notes))
