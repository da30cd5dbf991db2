from dataclasses import replace

import numpy as np
import pytest

from by_night import by_night
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.judge.findings import shown
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search import richer_laws, rival_candidates
from identification.diagnosis.search import rival_sets as rivals
from identification.diagnosis.search.richer_laws import odds_of_richer
from identification.diagnosis.search.rival_sets import (
    RivalComparison,
    _with_best_shapes,
    compare_with_rivals,
    with_leading_rivals,
)
from identification.diagnosis.search.search import with_wide_tolerances
from identification.diagnosis.search.stepwise import stepwise_search
from identification.pipeline import diagnose
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion


def silent(_: str) -> None:
    """Reports no progress."""


def comparisons(prepared) -> dict[tuple[str, str | None], object]:
    search = prepared.search
    chosen = stepwise_search(search, silent)
    return {term.effect_joint: compare_with_rivals(search, chosen, term) for term in chosen}


def rival_sets(comparison) -> list[set[str]]:
    return [{effect.effect for effect in rival.effects} for rival in comparison.rivals]


def test_a_clear_finding_has_no_rivals(lab, planar2):
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -np.sign(motion.v) * [0.0, 0.5]),))
    comparison = comparisons(prepared)[("coulomb_friction", "elbow")]
    assert comparison.probability == 1.0
    assert comparison.rivals == ()


def test_a_richer_law_of_the_same_kind_that_earns_its_price_takes_the_place_of_a_simpler_one(lab, planar2):
    # Known truth: a drag that is stronger one way, though a search that claims a gain of 2000 sees Coulomb friction.
    motion = lab.motion(2, 3)
    drag = np.where(motion.v > 0, 0.06, 0.0) * motion.v + 0.5 * np.sign(motion.v)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -drag * [0.0, 1.0]),))
    coulomb = frozenset([prepared.term("coulomb_friction", "elbow")])
    (term,) = with_leading_rivals(prepared.searched(2000.0), coulomb)
    assert term.effect_joint == ("direction_dependent_friction", "elbow")


@pytest.mark.parametrize(("rate", "listed"), [(0.3, False), (6.0, True)])
def test_friction_that_falls_at_low_speeds_is_a_rival_where_no_motion_is_slow(lab, planar2, rate, listed):
    # Known truth: Coulomb friction. A slow motion shows the lowest speeds, a fast one jumps over them.
    t = np.arange(1000) / 100.0
    w, phase = 2.0 * np.pi * rate * np.array([1.0, 1.13]), np.array([0.0, 0.4])
    x = np.outer(t, w) + phase
    motion = Motion(t, 0.3 * np.sin(x), 0.3 * w * np.cos(x), -0.3 * w**2 * np.sin(x))
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -0.1 * np.sign(motion.v) * [0.0, 1.0]),))
    names = rival_sets(comparisons(prepared)[("coulomb_friction", "elbow")])
    assert ({"stribeck_friction"} in names) is listed


@pytest.fixture(scope="module")
def heavier(lab):
    """A slide without gravity whose mass is 30 kg larger than modelled: four effects predict the same."""
    slide = load_robot("emps")
    motion = lab.motion(1, 2, swing=0.2)
    return lab.prepared(slide, (lab.recording(slide, motion, -30.0 * motion.a, noise=2.0),))


def test_exact_twins_share_their_wins_but_for_a_rare_size(heavier):
    # Closed form: mass of the carriage, of a payload, of the rotor, and a torque constant all leave a force
    # proportional to the acceleration. The torque constant is that of 95.1 kg in place of 125.1; a half is two
    # deviations from one.
    ((place, comparison),) = comparisons(heavier).items()
    options = [place, *((r.effects[0].effect, r.effects[0].joint) for r in comparison.rivals)]
    assert set(options) == {
        ("rotor_inertia", "axis"),
        ("inertial_parameters", "axis"),
        ("payload", None),
        ("torque_constant", "axis"),
    }
    rare = np.exp(-0.5 * (4.0 * (1.0 - 95.1 / 125.1)) ** 2)
    assert comparison.probability == pytest.approx(1.0 / (3.0 + rare), abs=0.02)


def test_a_rival_of_a_size_that_no_robot_has_is_none_where_another_may_be(heavier, monkeypatch):
    # By hand: of four effects that predict the same, one is said to have an impossible size.
    def impossible(robot, term, theta, cov):
        return (None, 0.0) if term.effect.name == "torque_constant" else None

    for module in (rivals, richer_laws):
        monkeypatch.setattr(module, "implausible_size", impossible)
    ((place, comparison),) = comparisons(heavier).items()
    options = {place[0], *(rival.effects[0].effect for rival in comparison.rivals)}
    assert options == {"rotor_inertia", "inertial_parameters", "payload"}
    assert comparison.probability == pytest.approx(1.0 / 3.0, abs=0.02)


def test_a_plausible_cause_that_explains_most_leads_beside_a_better_fit_of_an_impossible_size(
    lab, planar2, monkeypatch
):
    # Known: Coulomb friction of 0.5 N m; viscous friction explains over half of it, and is hopeless as a fit.
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -np.sign(motion.v) * [0.0, 0.5]),))
    search = prepared.search
    coulomb, viscous = (prepared.term(name, "elbow") for name in ("coulomb_friction", "viscous_friction"))

    def impossible(robot, term, theta, cov):
        return None if term is viscous else (coulomb.effect.parameters(planar2, "elbow")[0], 0.5)

    chosen = frozenset([coulomb])
    assert compare_with_rivals(search, chosen, coulomb).probability == 1.0
    for module in (rivals, richer_laws):
        monkeypatch.setattr(module, "implausible_size", impossible)
    assert compare_with_rivals(search, chosen, coulomb).probability == 1.0
    # Of a robot that was diagnosed before.
    session = replace(search.problem.session, known=(KnownEffect("torque_offset", "elbow", (0.0,)),))
    known = replace(search, problem=replace(search.problem, session=session))
    comparison = compare_with_rivals(known, chosen, coulomb)
    assert (comparison.probability, comparison.leading_set) == (0.0, frozenset([viscous]))


def test_coulomb_friction_with_an_offset_and_direction_dependent_friction_are_twins(lab, planar2):
    # Closed form: steps of 0.5 and 0.2 are a Coulomb torque of 0.35 and an offset of 0.15.
    motion = lab.motion(2, 3)
    torque = np.where(motion.v > 0, -0.5, 0.2) * [0.0, 1.0]
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    found = comparisons(prepared)
    assert {place[1] for place in found} == {"elbow"}
    options = [{place[0] for place in found}, *(names for s in found.values() for names in rival_sets(s))]
    assert {"direction_dependent_friction"} in options
    assert {"coulomb_friction", "torque_offset"} in options


def test_a_law_has_at_least_the_odds_that_its_parts_give_it(lab, pendulum):
    # Known truth: a Coulomb torque with an offset, so that the law of both has numbers that nothing needs.
    motion = lab.motion(1, 3)
    torque = np.where(motion.v > 0, -0.5, 0.2) - 0.002 * motion.v
    prepared = lab.prepared(pendulum, (lab.recording(pendulum, motion, torque, noise=0.1),))
    names = ("coulomb_friction", "torque_offset", "direction_dependent_friction")
    coulomb, offset, rich = (prepared.term(name, "pin") for name in names)
    parts, whole = frozenset([coulomb, offset]), frozenset([rich])
    odds = odds_of_richer(prepared.search, parts, whole)
    comparison = compare_with_rivals(prepared.search, whole, rich)
    of_parts = next(one for one in comparison.rivals if {e.effect for e in one.effects} == set(names[:2]))
    assert 0.0 < odds < 1.0
    assert comparison.probability >= odds * of_parts.probability > 0.0


@pytest.fixture(scope="module")
def equal_slopes(lab, pendulum):
    """Steps of 0.5 and 0.2, which are a Coulomb torque of 0.35 and an offset of 0.15, beside one slope."""
    motion = lab.motion(1, 3)
    torque = np.where(motion.v > 0, -0.5, 0.2) - 0.3 * motion.v
    return lab.prepared(pendulum, (lab.recording(pendulum, motion, torque, noise=0.02),))


@pytest.mark.parametrize("names", [("coulomb_friction",), ("torque_offset",), ("viscous_friction",), ()])
def test_direction_dependent_friction_of_equal_slopes_is_as_likely_as_its_parts_together(equal_slopes, names):
    # Closed form. The law has a slope more, which noise moves, so that a few of the repeated choices differ.
    prepared = equal_slopes
    parts = frozenset(prepared.term(name, "pin") for name in ("coulomb_friction", "torque_offset", "viscous_friction"))
    whole = prepared.term("direction_dependent_friction", "pin")
    term = next((one for one in parts if (one.effect.name,) == names), whole)
    comparison = compare_with_rivals(prepared.search, parts if names else frozenset([whole]), term)
    instead = {one.effects: one.probability for one in comparison.rivals}
    other = next(
        share
        for effects, share in instead.items()
        if {one.effect for one in effects} == ({whole.effect.name} if names else {one.effect.name for one in parts})
    )
    assert comparison.probability == pytest.approx(other, abs=0.05)


@pytest.mark.parametrize("seed", by_night(range(5), 0))
def test_probabilities_of_a_finding_and_its_rivals_sum_to_one(lab, pendulum, seed):
    # A weak difference of the directions, which several laws explain; those that win seldom are not listed.
    motion = lab.motion(1, seed)
    torque = -np.where(motion.v > 0, 0.25, 0.18) * np.sign(motion.v) - 0.1 * motion.v
    prepared = lab.prepared(pendulum, (lab.recording(pendulum, motion, torque, noise=0.2, seed=seed),))
    found = comparisons(prepared)
    assert found
    for comparison in found.values():
        total = comparison.probability + sum(rival.probability for rival in comparison.rivals)
        assert total == pytest.approx(1.0)


def test_rivals_have_a_twentieth_at_least_and_come_in_order(heavier):
    (comparison,) = comparisons(heavier).values()
    shares = [rival.probability for rival in comparison.rivals]
    assert shares == sorted(shares, reverse=True)
    assert min(shares) >= 0.05


def odds_of_one_way(lab, robot, motion, drag) -> float:
    """Odds of direction-dependent against Coulomb friction on the elbow."""
    prepared = lab.prepared(robot, (lab.recording(robot, motion, -drag[:, None] * [0.0, 1.0]),))
    coulomb, rich = (
        frozenset([prepared.term(name, "elbow")]) for name in ("coulomb_friction", "direction_dependent_friction")
    )
    return odds_of_richer(prepared.search, coulomb, rich)


def test_friction_that_is_clearly_the_same_both_ways_leaves_no_odds_for_another_law(lab, planar2):
    motion = lab.motion(2, 3)
    assert odds_of_one_way(lab, planar2, motion, 0.5 * np.sign(motion.v[:, 1])) < 0.01


def test_friction_that_is_clearly_stronger_one_way_has_even_odds_at_least(lab, planar2):
    motion = lab.motion(2, 3)
    assert odds_of_one_way(lab, planar2, motion, np.where(motion.v[:, 1] > 0, 0.8, -0.2)) == 1.0


def test_friction_that_hardly_shows_leaves_room_for_another_law(lab, planar2):
    # Two tenths of the noise: what it is one way and the other is anyone's guess.
    motion = lab.motion(2, 3)
    weak = odds_of_one_way(lab, planar2, motion, 0.01 * np.sign(motion.v[:, 1]))
    strong = odds_of_one_way(lab, planar2, motion, 0.5 * np.sign(motion.v[:, 1]))
    assert weak > 10 * strong


def test_standings_agree_from_both_sides(lab, planar2):
    # Stood for by each other, two laws win as often whoever was found first.
    motion = lab.motion(2, 5)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -np.tanh(4 * motion.v) * [0.0, 0.05]),))
    viscous, coulomb = prepared.term("viscous_friction", "elbow"), prepared.term("coulomb_friction", "elbow")

    def share(found, other) -> float:
        comparison = compare_with_rivals(prepared.search, frozenset([found]), found)
        wins = {rival.effects[0].effect: rival.probability for rival in comparison.rivals if len(rival.effects) == 1}
        return wins.get(other.effect.name, 0.0) / (wins.get(other.effect.name, 0.0) + comparison.probability)

    assert share(viscous, coulomb) == pytest.approx(1.0 - share(coulomb, viscous), abs=0.05)


@pytest.mark.whole
def test_a_rival_does_not_win_by_making_up_for_an_effect_that_is_not_reported(lab, planar2, monkeypatch):
    # Known truth: drives that are late by 7 and by 9 ms. Were the first one taken for nothing where the second one is
    # judged, one delay of all drives would seem to be the better name.
    now, later, latest = (lab.motion(2, 3, rate=500.0, swing=1.5, ahead=lead) for lead in (0.0, 0.007, 0.009))
    asked = np.column_stack([inverse_dynamics(planar2, m)[:, j] for j, m in enumerate((later, latest))])
    log = replace(lab.recording(planar2, now), tau=asked + 0.02 * np.random.default_rng(0).normal(size=asked.shape))

    def hidden(context, state):
        kept = frozenset(term for term in state.shown if term.joint == "elbow")
        return state if kept == state.shown else replace(state, shown=kept)

    monkeypatch.setattr(shown, "_motion_gate", hidden)
    (finding,) = diagnose(planar2, (log,)).findings
    # A lag of the same drive ties: what separates it from a delay is above the frequencies of the motion.
    listed = {(finding.effect, finding.joint)}
    listed |= {(effect.effect, effect.joint) for rival in finding.rivals for effect in rival.effects}
    assert listed == {("input_delay", "elbow"), ("actuator_lag", "elbow")}


def test_findings_are_looked_at_again_beside_a_rival_that_takes_a_place(lab, planar2, monkeypatch):
    # Known truth: the first finding is less probable only beside what takes the second one's place.
    prepared = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, 3)),))
    names = ("coulomb_friction", "torque_offset", "viscous_friction", "input_delay")
    first, second, third, fourth = (prepared.term(name, "elbow") for name in names)
    better = {(second, frozenset({first, second})): {first, third}, (first, frozenset({first, third})): {fourth, third}}

    def comparison(search, chosen, term):
        instead = better.get((term, chosen))
        named = (Rival((EffectAt("x", None),), 0.9),) if instead else ()
        return RivalComparison(0.1, named, frozenset(instead) if instead else None)

    monkeypatch.setattr(rivals, "compare_with_rivals", comparison)
    assert with_leading_rivals(prepared.search, frozenset({first, second})) == {fourth, third}


def test_wide_tolerances_are_three_times_as_wide_and_leave_effects_alone(quiet):
    narrow, wide = quiet.search.problem, with_wide_tolerances(quiet.search).problem
    nuisances = narrow.nuisance_count
    np.testing.assert_allclose(wide.precision[:nuisances], narrow.precision[:nuisances] / 9.0)
    np.testing.assert_allclose(wide.upper[:nuisances], 3.0 * narrow.upper[:nuisances])
    np.testing.assert_array_equal(wide.precision[nuisances:], narrow.precision[nuisances:])


def test_what_survives_every_repetition_is_as_certain_as_before(quiet):
    chosen = frozenset([quiet.term("viscous_friction", "elbow")])
    (term,) = chosen
    alone, repeated = (
        compare_with_rivals(quiet.search, chosen, term, other_conditions=again) for again in ((), (quiet.search,))
    )
    total = repeated.probability + sum(rival.probability for rival in repeated.rivals)
    assert total == pytest.approx(1.0)
    assert abs(alone.probability - repeated.probability) < 0.5


def test_where_a_law_ends_on_a_special_case_that_case_takes_its_place(quiet):
    # By definition: the set with exactly the effects of those places in place of the finding.
    finding, beside = quiet.term("stribeck_friction", "elbow"), quiet.term("torque_offset", "shoulder")
    places = (("coulomb_friction", "elbow"), ("viscous_friction", "elbow"))
    leading = _with_best_shapes(quiet.search, frozenset([finding, beside]), finding, places)
    assert {one.effect_joint for one in leading} == {*places, beside.effect_joint}


def test_a_place_that_is_no_rival_leads_to_nothing(quiet):
    finding = quiet.term("coulomb_friction", "elbow")
    assert _with_best_shapes(quiet.search, frozenset([finding]), finding, (("coulomb_friction", "wrist"),)) is None


@pytest.mark.parametrize(
    ("finding", "other", "joint", "nested"),
    [
        ("coulomb_friction", "stribeck_friction", "elbow", True),
        ("stribeck_friction", "coulomb_friction", "elbow", True),
        ("torque_offset", "parasitic_spring", "elbow", True),
        ("parasitic_spring", "torque_offset", "elbow", True),
        ("torque_offset", "parasitic_spring", "shoulder", False),
        ("torque_constant", "payload", None, False),
    ],
)
def test_which_laws_contain_each_other_or_come_arbitrarily_near(quiet, finding, other, joint, nested):
    # By definition of the laws: a soft spring that rests far away is an offset.
    term = quiet.term(finding, "elbow")
    assert rivals.is_nested(term, frozenset([quiet.term(other, joint)])) is nested


@pytest.mark.parametrize(("finding", "priced"), [("torque_constant", False), ("parasitic_spring", True)])
def test_several_effects_together_keep_their_price_but_not_beside_an_effect_that_resembles_their_sum(
    quiet, finding, priced
):
    both = frozenset([quiet.term("coulomb_friction", "elbow"), quiet.term("viscous_friction", "elbow")])
    assert rivals.is_nested(quiet.term(finding, "elbow"), both) is priced


@pytest.mark.parametrize(("band", "everywhere", "asked"), [(True, True, 2), (True, False, 2), (False, False, 1)])
def test_a_rival_is_left_out_only_where_it_is_hopeless_in_the_judged_band_too(
    quiet, monkeypatch, band, everywhere, asked
):
    # Known: a search of other data is asked as well, one of the same band with wider tolerances is not.
    term, search, searches = quiet.term("viscous_friction", "elbow"), quiet.search, []
    white = search.problem.white
    other = replace(search, problem=replace(search.problem, white=replace(white) if band else white))

    def hopeless(one, *_, priced):
        searches.append(one)
        return everywhere or one is search

    monkeypatch.setattr(rival_candidates, "is_far_worse", hopeless)
    chosen = frozenset([term])
    options, _, _ = rival_candidates.candidate_sets(search, chosen, term, frozenset(), (other,), must_fit_well=True)
    assert len({id(one) for one in searches}) == asked
    assert (len(options) > 1) == (band and not everywhere)
