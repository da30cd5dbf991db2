from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.terms import ordered
from identification.diagnosis.search import stepwise
from identification.diagnosis.search.claims import rows_of_term
from identification.diagnosis.search.containment import can_join, contains, relations, with_term
from identification.diagnosis.search.record import Record
from identification.diagnosis.search.search import Threshold, parameter_counts, price
from identification.diagnosis.search.stepwise import forward_selection, stepwise_search
from identification.diagnosis.search.swaps import alternatives, with_replacement
from identification.gates import above_chance
from identification.stages import Announcement, Stage
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.motion import Motion


def places(terms) -> set[tuple[str, str | None]]:
    return {term.effect_joint for term in terms}


def silent(_: str) -> None:
    """Reports no progress."""


@pytest.fixture(scope="module")
def rubbing(lab, planar2):
    """The planar arm with Coulomb friction on the elbow that its model lacks."""
    motion = lab.motion(2, 3)
    return lab.prepared(planar2, (lab.recording(planar2, motion, -np.sign(motion.v) * [0.0, 0.3]),))


@pytest.fixture(scope="module")
def two_lacking(lab, planar2):
    """The planar arm with Coulomb friction on the elbow and viscous friction on the shoulder that its model lacks."""
    motion = lab.motion(2, 3)
    torque = -np.sign(motion.v) * [0.0, 0.3] - motion.v * [0.3, 0.0]
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


@pytest.mark.parametrize(("size", "cost"), [(0, 0.0), (1, 5.0), (4, 20.0), (10, 26.0)])
def test_four_parameters_pay_in_full_and_each_more_what_chance_gives(size, cost):
    assert price(size) == cost
    assert price(1) == above_chance.PARAMETER_PRICE


@pytest.mark.parametrize(
    ("rich", "simple", "joint"),
    [
        ("direction_dependent_friction", "coulomb_friction", "elbow"),
        ("direction_dependent_friction", "viscous_friction", "elbow"),
        ("direction_dependent_friction", "torque_offset", "elbow"),
        ("stribeck_friction", "coulomb_friction", "shoulder"),
    ],
)
def test_a_richer_law_contains_its_special_cases(quiet, rich, simple, joint):
    assert contains(quiet.term(rich, joint), quiet.term(simple, joint))
    assert not contains(quiet.term(simple, joint), quiet.term(rich, joint))


def test_a_law_on_one_joint_does_not_contain_one_on_another(quiet):
    rich = quiet.term("direction_dependent_friction", "elbow")
    assert not contains(rich, quiet.term("coulomb_friction", "shoulder"))


def test_nothing_contains_itself(quiet):
    assert not any(contains(term, term) for term in quiet.columns.terms)


def test_inertias_of_all_links_contain_those_of_one_and_the_payload(quiet):
    whole = quiet.term("inertial_parameters", None)
    assert contains(whole, quiet.term("inertial_parameters", "elbow"))
    assert contains(whole, quiet.term("payload", None))


def test_inertias_of_the_last_link_contain_the_payload_and_those_of_the_first_do_not(quiet):
    payload = quiet.term("payload", None)
    assert contains(quiet.term("inertial_parameters", "elbow"), payload)
    assert not contains(quiet.term("inertial_parameters", "shoulder"), payload)


def test_a_richer_law_takes_the_place_of_its_special_cases(quiet):
    chosen = frozenset([quiet.term("coulomb_friction", "elbow"), quiet.term("coulomb_friction", "shoulder")])
    rich = with_term(chosen, quiet.term("direction_dependent_friction", "elbow"))
    assert places(rich) == {("direction_dependent_friction", "elbow"), ("coulomb_friction", "shoulder")}


def test_a_law_has_one_shape_at_a_time(quiet):
    shapes = [term for term in quiet.columns.terms if term.effect_joint == ("stribeck_friction", "elbow")]
    assert with_term(frozenset([shapes[0]]), shapes[3]) == frozenset([shapes[3]])


def test_two_rich_friction_laws_do_not_stand_side_by_side(quiet):
    one = frozenset([quiet.term("stribeck_friction", "elbow")])
    rich = quiet.term("direction_dependent_friction", "elbow")
    assert with_term(one, rich) == frozenset([rich])


def test_a_special_case_of_what_is_there_is_not_tried(quiet):
    chosen = frozenset([quiet.term("direction_dependent_friction", "elbow")])
    assert not can_join(chosen, quiet.term("coulomb_friction", "elbow"))
    assert can_join(chosen, quiet.term("coulomb_friction", "shoulder"))
    assert not can_join(chosen, quiet.term("direction_dependent_friction", "elbow"))


def test_special_cases_together_are_an_alternative_to_a_richer_law(quiet):
    rich = quiet.term("direction_dependent_friction", "elbow")
    several = [places(group) for group in alternatives(quiet.search, rich)]
    assert {("coulomb_friction", "elbow"), ("torque_offset", "elbow")} in several


def test_replacing_keeps_the_other_effects(quiet):
    coulomb, viscous = quiet.term("coulomb_friction", "elbow"), quiet.term("viscous_friction", "elbow")
    kept = quiet.term("rotor_inertia", "shoulder")
    assert with_replacement(frozenset([coulomb, kept]), coulomb, frozenset([viscous])) == frozenset([viscous, kept])


def test_the_order_of_terms_is_that_of_their_columns(quiet):
    terms = quiet.columns.terms
    assert ordered(reversed(terms)) == ordered(terms)
    assert [t.columns for t in ordered(terms)] == sorted(t.columns for t in terms)


@pytest.mark.parametrize(
    ("effect", "joint", "rank"),
    [
        ("viscous_friction", "elbow", 1),
        ("direction_dependent_friction", "elbow", 4),
        ("parasitic_spring", "elbow", 2),
        ("stribeck_friction", "elbow", 3),
        # In the plane of x and z a body has three gravity and inertia parameters about its hinge.
        ("inertial_parameters", "elbow", 4),
    ],
)
def test_the_rank_of_an_effect_is_its_number_of_independent_directions(quiet, effect, joint, rank):
    term = quiet.term(effect, joint)
    assert parameter_counts(quiet.problem, (term,)) == {term: rank}


def test_an_effect_of_a_joint_that_rests_is_no_rival(lab, planar2):
    motion = lab.motion(2)
    held = Motion(motion.t, motion.q * [1, 0], motion.v * [1, 0], motion.a * [1, 0])
    prepared = lab.prepared(planar2, (replace(lab.recording(planar2, held), q=held.q),))
    at_rest = prepared.term("viscous_friction", "elbow")
    assert parameter_counts(prepared.problem, (at_rest,)) == {at_rest: 0}
    assert at_rest not in prepared.search.terms


def test_a_set_scores_its_held_out_loss_and_its_price(quiet):
    term = quiet.term("viscous_friction", "elbow")
    search = quiet.search
    found = search.held_out_fit(frozenset([term]))
    assert search.score(frozenset([term])) == pytest.approx(found.loss.sum() + found.penalty + 5.0 + 0.02)


def test_a_fit_is_made_once(quiet):
    search = quiet.search
    chosen = frozenset([quiet.term("viscous_friction", "elbow")])
    assert search.held_out_fit(chosen) is search.held_out_fit(frozenset(chosen))


def test_nothing_is_claimed_without_a_gap(quiet):
    assert stepwise_search(quiet.search, silent) == frozenset()


def test_two_effects_at_once_are_found_on_their_joints(two_lacking):
    # Known truth.
    assert places(stepwise_search(two_lacking.search, silent)) == {
        ("coulomb_friction", "elbow"),
        ("viscous_friction", "shoulder"),
    }


def test_the_result_of_an_earlier_search_is_compared_with_its_rivals_before_effects_join_it(rubbing, monkeypatch):
    # Known truth: Coulomb friction on the elbow, where the earlier search found viscous friction.
    begun = []
    monkeypatch.setattr(stepwise, "forward_selection", lambda search, chosen, _: begun.append(chosen) or chosen)
    stepwise_search(rubbing.search, silent, frozenset([rubbing.term("viscous_friction", "elbow")]))
    assert places(begun[0]) == {("coulomb_friction", "elbow")}


def test_a_threshold_that_no_gain_reaches_keeps_every_claim_away(rubbing):
    assert stepwise_search(rubbing.searched(1e9), silent) == frozenset()


@pytest.mark.parametrize(("above", "found"), [(-1.0, True), (1.0, False)])
def test_a_gain_is_compared_with_chance_before_its_price_is_paid(lab, planar2, monkeypatch, above, found):
    # Known truth: friction on the elbow. What gains more than chance in sample is tried, whatever it costs.
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -np.sign(motion.v) * [0.0, 0.1]),))
    term, search = prepared.term("coulomb_friction", "elbow"), prepared.search
    gain = search.in_sample_loss(frozenset()) - search.in_sample_loss(frozenset([term]))
    asked = []
    monkeypatch.setattr(stepwise, "passes_gates", lambda search, rich, plain: asked.extend(rich - plain))
    forward_selection(prepared.searched(gain + above), frozenset(), silent)
    assert (term in asked) == found


def test_the_search_tells_what_it_does(quiet):
    said: list[Announcement] = []
    stepwise_search(quiet.search, said.append)
    assert said[0] == Announcement(Stage.RIVALS_TRIED, detail={"found": 0})
    assert Announcement(Stage.ALTERNATIVES) in said


def test_what_gives_way_and_what_contains_is_looked_up_as_it_is_computed(quiet):
    removed_by, contained_in = relations(quiet.columns.terms)
    everything = frozenset(quiet.columns.terms)
    for term in quiet.columns.terms:
        assert removed_by(term) == {other for other in everything if term not in with_term({term}, other)} | {term}
        assert contained_in(term) == {other for other in everything if contains(other, term)}


def test_what_is_possible_is_looked_up_as_it_is_computed(quiet):
    search, chosen = quiet.search, frozenset([quiet.term("stribeck_friction", "elbow")])
    assert [search.can_join(chosen, term) for term in search.terms] == [can_join(chosen, term) for term in search.terms]


def test_gains_above_what_is_asked_for_are_those_of_the_fits_of_all(lab, planar2):
    motion = lab.motion(2, 3)
    torque = -np.sign(motion.v) * [0.2, 0.25] - motion.v * [0.15, 0.0]
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    search, chosen = prepared.search, frozenset([prepared.term("coulomb_friction", "elbow")])
    every = search.gains(chosen, search.terms)
    largest = max(every.values())
    for least in (0.9 * largest, 0.5 * largest, 0.1 * largest):
        some = search.gains(chosen, search.terms, above=least)
        above = {term: gain for term, gain in every.items() if gain >= least}
        assert above
        assert {term: gain for term, gain in some.items() if gain >= least} == above


def test_a_search_that_goes_in_a_circle_ends_with_the_best_set_of_it(two_lacking, monkeypatch):
    # Known truth: whatever is added is dropped again together with everything else, every time.
    visited: list[frozenset] = []

    def all_or_nothing(search, chosen):
        assert len(visited) < 20
        visited.append(chosen if len(chosen) < 2 else frozenset())
        return visited[-1]

    monkeypatch.setattr(stepwise, "backward_elimination", all_or_nothing)
    found = stepwise.forward_selection(two_lacking.search, frozenset(), silent)
    assert found == min(visited, key=two_lacking.search.score)


def test_a_coupling_is_compared_with_friction_of_each_of_its_joints(quiet):
    coupling = quiet.term("joint_coupling", "shoulder+elbow")
    sets = {frozenset(places(group)) for group in alternatives(quiet.search, coupling)}
    each = [(name, joint) for name in ("coulomb_friction", "viscous_friction") for joint in ("shoulder", "elbow")]
    assert frozenset(each) in sets
    assert frozenset(each[:3]) in sets
    elbow = quiet.term("stribeck_friction", "elbow")
    assert frozenset(each) not in {frozenset(places(group)) for group in alternatives(quiet.search, elbow)}


def test_single_effects_take_the_place_of_free_inertias_that_hold_a_little_of_each(lab, arm):
    # Known truth: heavier rotors on joints that turn, tilt and slide.
    motion = lab.motion(3, 4)
    prepared = lab.prepared(arm, (lab.recording(arm, motion, -motion.a * [0.05, 0.03, 0.3]),))
    whole = frozenset([prepared.term("inertial_parameters", None)])
    found = stepwise._by_single_effects(prepared.search, whole, silent)
    assert places(found) == {("rotor_inertia", joint) for joint in arm.joint_names}


def test_friction_of_each_joint_takes_the_place_of_a_torque_constant_for_all(lab, arm):
    # Known truth: more friction on each joint, to which a scale of all torques comes near.
    motion = lab.motion(3, 4)
    prepared = lab.prepared(arm, (lab.recording(arm, motion, -np.sign(motion.v) * [0.9, 0.7, 0.8]),))
    whole = prepared.term("torque_constant", "+".join(arm.joint_names))
    found = stepwise._by_single_effects(prepared.search, frozenset([whole]), silent)
    assert places(found) == {("coulomb_friction", joint) for joint in arm.joint_names}


@pytest.mark.parametrize("body", [("inertial_parameters", "elbow"), ("inertial_parameters", None)])
def test_a_torque_constant_of_several_joints_is_not_tried_beside_bodies(quiet, body):
    # Together they are wrong friction by another name; a torque constant of one joint stays.
    scale, single = (quiet.term("torque_constant", joint) for joint in ("shoulder+elbow", "elbow"))
    assert with_term(frozenset([scale]), quiet.term(*body)) == {quiet.term(*body)}
    assert with_term(frozenset([quiet.term(*body)]), scale) == {scale}
    assert with_term(frozenset([single]), quiet.term(*body)) == {single, quiet.term(*body)}


def test_free_inertias_stay_where_single_effects_explain_less(lab, arm):
    # Known truth: each link has masses and products of inertia that no other effect makes.
    motion = lab.motion(3, 4)
    whole = lab.prepared(arm, (lab.recording(arm, motion),)).term("inertial_parameters", None)
    robot = with_parameters(arm, np.random.default_rng(1).uniform(0.1, 0.3, arm.model.njoints * 10 - 10))
    torque = inverse_dynamics(arm, motion) - inverse_dynamics(robot, motion)
    prepared = lab.prepared(arm, (lab.recording(arm, motion, torque),))
    chosen = frozenset([prepared.term(*whole.effect_joint)])
    assert stepwise._by_single_effects(prepared.search, chosen, silent) == chosen


def test_the_search_tries_single_effects_in_place_of_richer_laws(quiet, monkeypatch):
    others = frozenset([quiet.term("rotor_inertia", "elbow")])
    monkeypatch.setattr(stepwise, "_by_single_effects", lambda search, chosen, progress: others)
    assert stepwise_search(quiet.search, silent) == others


def test_sets_of_the_same_rivals_have_the_same_order_however_often_they_are_made(quiet):
    # What depends on the order of a set would differ from run to run otherwise.
    again = [replace(term) for term in quiet.search.terms]
    first, second = (
        [(term.effect_joint, term.shape) for term in frozenset(terms)] for terms in (quiet.search.terms, again)
    )
    assert first == second


class Outside:
    """A search whose scores are given: two structures of one shape, of which the second scores better."""

    def __init__(self, problem, terms, scores):
        self.problem, self.terms, self.scores = problem, terms, scores
        self.threshold, self.record = Threshold(5.0, {}), Record()
        self.counts = {term: 4 for term in terms}

    def parameter_count(self, terms):
        return sum(self.counts[term] for term in terms)

    def score(self, chosen):
        return self.scores[chosen]

    def gains(self, _, terms, above=0.0):
        return {term: 100.0 - k for k, term in enumerate(terms)}


def test_of_several_structures_without_a_name_the_best_is_taken_and_not_the_first(quiet, monkeypatch):
    one, other = [term for term in quiet.search.terms if not term.named][:2]
    nothing, first, best = frozenset(), frozenset([one]), frozenset([other])
    monkeypatch.setattr(stepwise, "passes_gates", lambda _, tried, __: tried in (first, best))
    monkeypatch.setattr(stepwise, "can_join", lambda base, _: not base)
    scores = {nothing: 400.0, first: 300.0, best: 298.0}
    found = stepwise.with_nameless(Outside(quiet.search.problem, (one, other), scores), nothing, silent)
    assert found == best


@pytest.mark.parametrize(("numbers", "in_one_sine", "needed"), [(3, False, 0.0), (1, False, 7.0), (3, True, 7.0)])
def test_of_one_law_with_fewer_numbers_than_several_effects_nothing_is_asked(quiet, numbers, in_one_sine, needed):
    # By hand: causes of one joint may be one, which asks for the threshold of 5 and the accuracy of 2.
    drag = quiet.term("drag", "elbow")
    gone = frozenset([quiet.term("viscous_friction", "elbow"), quiet.term("stribeck_friction", "elbow")])
    search = Outside(quiet.search.problem, (drag, *gone), {})
    search.counts = {term: numbers for term in gone} | {drag: 5}
    assert stepwise._least_nameless_gain(search, drag, gone, 2.0, in_one_sine=in_one_sine) == needed


def test_a_single_effect_does_not_imitate_a_structure_whatever_its_numbers(quiet):
    drag, gone = quiet.term("drag", "elbow"), quiet.term("direction_dependent_friction", "elbow")
    search = Outside(quiet.search.problem, (drag, gone), {})
    search.counts = {drag: 2, gone: 4}
    assert stepwise._least_nameless_gain(search, drag, frozenset([gone]), 2.0, in_one_sine=False) == 7.0


def test_a_structure_makes_needless_no_effect_that_touches_none_of_its_joints(quiet, monkeypatch):
    # Oracle: the statement itself. `passes_gates` says no to all that it is asked, so all that is doubted goes.
    problem, terms = quiet.search.problem, quiet.search.terms
    structure = next(term for term in terms if not term.named)
    rows = rows_of_term(problem, structure)
    friction = [term for term in terms if term.effect.name == "viscous_friction"]
    here = next(term for term in friction if rows_of_term(problem, term) & rows)
    elsewhere = next(term for term in friction if not rows_of_term(problem, term) & rows)
    chosen, nothing = frozenset([here, elsewhere]), frozenset()
    scores = {chosen: 400.0, chosen | {structure}: 350.0, frozenset([structure, elsewhere]): 300.0}
    asked = []
    monkeypatch.setattr(stepwise, "passes_gates", lambda _, tried, without: asked.append(tried ^ without))
    search = Outside(problem, (structure,), scores)
    for base in (chosen, nothing):
        assert stepwise._with_needed_only(search, structure, base, chosen) == {structure, elsewhere}
    assert all(elsewhere not in doubted for doubted in asked)
    assert asked
