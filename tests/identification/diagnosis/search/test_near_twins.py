"""Near twins in the search. Oracle: the table of relations, and the laws of friction that hold more than one number.

Effects that imitate a finding where joints move along one line. Oracle: joints whose load never changes.

Sizes that no sound robot has. Oracles: by hand, and recorded torques and speeds.

Shortcuts for robots of many joints and effects. Oracle: the same search without them, and a known truth.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from identification.data.recording import Recording
from identification.diagnosis.judge.findings.imitation import (
    LARGEST_PROBABILITY,
    imitation_of,
    joints_on_lines,
    with_imitation,
    with_limit,
)
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search import claims, swaps
from identification.diagnosis.search import search as search_module
from identification.diagnosis.search.claims import _torque_with_twins, backward_elimination
from identification.diagnosis.search.containment import are_near_twins
from identification.diagnosis.search.fair_costs import weighted_by_rarity
from identification.diagnosis.search.plausible_sizes import implausible_size, rarity
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.diagnosis.search.special_cases import (
    certainty_of_difference,
    nearest_case_at_shape,
    simplest_effects,
    vanishes_at_bound,
)
from identification.diagnosis.search.stepwise import forward_selection
from identification.diagnosis.search.swaps import alternatives, with_swaps
from identification.scenarios.motion_only import commanded_robot, with_commanded_torque
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Actuator, Controller
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import simulate
from places import ROBOTS


@pytest.fixture(scope="module")
def servo(lab):
    """A rod that a position servo swings, known by its references alone."""
    robot = replace(load_robot(ROBOTS / "pendulum.urdf"), actuators=(Actuator(controller=Controller(kp=60.0, kd=6.0)),))
    t = np.arange(2400) / 200.0
    q_ref = (0.4 * np.sin(1.7 * t) + 0.2 * np.sin(4.3 * t))[:, None]
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=np.array([60.0]), kd=np.array([6.0]))
    q = simulate(robot, (), law, t, np.zeros(1)).q + 1e-5 * np.random.default_rng(1).standard_normal(q_ref.shape)
    recording = with_commanded_torque(Recording("s.csv", robot.joint_names, t, q, None, q_ref=q_ref), robot)
    return lab.prepared(commanded_robot(robot), (recording,))


def test_a_late_reference_and_viscous_friction_are_near_twins(servo):
    late, viscous, dry = (servo.term(n, "pin") for n in ("reference_delay", "viscous_friction", "coulomb_friction"))
    assert are_near_twins(late, viscous)
    assert are_near_twins(viscous, late)
    assert not are_near_twins(late, dry)


@pytest.mark.parametrize(("effect", "twin"), [("reference_delay", "viscous_friction"),
                                              ("viscous_friction", "reference_delay")])  # fmt: skip
def test_a_near_twin_may_stand_beside_what_a_richer_law_has(servo, effect, twin):
    # Direction-dependent friction holds Coulomb and viscous friction: a twin alone would be compared with both.
    groups = {
        frozenset(one.effect.name for one in group) for group in alternatives(servo.search, servo.term(effect, "pin"))
    }
    assert {twin} in groups
    assert {twin, "coulomb_friction"} in groups
    assert {effect, twin} in groups


def test_other_effects_have_no_near_twin_beside_them(servo):
    groups = alternatives(servo.search, servo.term("torque_offset", "pin"))
    assert not any({"reference_delay", "coulomb_friction"} <= {one.effect.name for one in group} for group in groups)


def test_beside_its_twin_an_effect_is_measured_by_the_torque_that_it_makes(servo):
    # Closed form: the squares of a column times its coefficient.
    late, viscous, dry = (servo.term(n, "pin") for n in ("reference_delay", "viscous_friction", "coulomb_friction"))
    rich = servo.search.held_out_fit(frozenset([late, viscous]))
    (column,) = viscous.columns
    made = rich.theta[column] ** 2 * rich.problem.total_a[column, column]
    assert _torque_with_twins(frozenset([viscous]), frozenset([late]), rich) == pytest.approx(made)
    assert _torque_with_twins(frozenset([viscous]), frozenset([dry]), rich) == 0.0


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
    return next(t for t in prepared.search.terms if t.effect_joint == (name, joint))


def test_both_joints_are_along_a_line(in_line):
    assert joints_on_lines(in_line.session) == {0, 1}


def test_friction_is_not_imitated_where_joints_move_freely(lab, planar2):
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "coulomb_friction", "elbow", 0.5)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    assert joints_on_lines(prepared.session) == frozenset()
    rubs = term(prepared, "coulomb_friction", "elbow")
    assert imitation_of(prepared.search, frozenset([rubs]), rubs) is None


def test_an_imitation_is_as_likely_as_what_it_imitates(in_line):
    known = Rival((EffectAt("stribeck_friction", "elbow"),), 0.1)
    loaded = term(in_line, "load_dependent_friction", "elbow")
    found = with_imitation(RivalComparison(0.9, (known,)), (loaded,))
    assert found.probability == 0.45
    assert found.rivals == (Rival((EffectAt("load_dependent_friction", "elbow"),), 0.45), known)
    assert with_imitation(RivalComparison(0.9, (known,)), None) == RivalComparison(0.9, (known,))


@pytest.mark.parametrize(
    ("name", "joint", "most"),
    [("payload", None, 0.85), ("torque_constant", "elbow", 0.85), ("viscous_friction", "elbow", 0.99)],
)
def test_no_load_and_no_torque_scale_is_certain_along_a_line_and_friction_is(in_line, name, joint, most):
    assert with_limit(RivalComparison(0.99, ()), term(in_line, name, joint), LARGEST_PROBABILITY).probability == most
    assert with_limit(RivalComparison(0.5, ()), term(in_line, name, joint), LARGEST_PROBABILITY).probability == 0.5


@pytest.mark.parametrize("deviations", [0.1, 1.0, 3.0])
def test_one_number_is_as_certain_as_the_normal_law_says(deviations):
    # Closed form: the square of a standard normal number.
    found = certainty_of_difference(np.array([0.2 * deviations]), np.array([[0.04]]))
    assert found == pytest.approx(2.0 * norm.cdf(deviations) - 1.0)


def test_units_do_not_matter_to_a_certainty():
    # Two independent numbers, one of them in millionths: three deviations of each are eighteen squared ones in all.
    found = certainty_of_difference(np.array([3.0, 3e-6]), np.diag([1.0, 1e-12]))
    assert found == pytest.approx(1.0 - np.exp(-0.5 * 18.0))


@pytest.mark.parametrize(("excess", "nothing"), [(0.0, False), (0.4, False), (9.0, True), (-0.9, True)])
def test_a_torque_constant_at_the_ends_of_what_is_possible_is_none(quiet, planar2, excess, nothing):
    # Closed form: a ratio of 1 / (1 + excess); a tenth and ten are the ends.
    assert vanishes_at_bound(planar2, quiet.term("torque_constant", "elbow"), np.array([excess])) == nothing


def test_the_votes_of_stribeck_friction_at_its_bound_belong_to_coulomb_friction(lab, planar2):
    # Known truth: friction that rises with speed, so that a torque that falls with it ends on its bound.
    motion = lab.motion(2, 3)
    torque = -np.sign(motion.v) * (0.5 + 0.2 * np.tanh(2 * np.abs(motion.v))) * [0.0, 1.0]
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    term = prepared.term("stribeck_friction", "elbow")
    found = prepared.search.held_out_fit(frozenset([term]))
    assert found.theta[term.columns[1]] == 0.0
    assert simplest_effects(planar2, term, found) == (("coulomb_friction", "elbow"),)


def test_a_fit_that_holds_a_displacement_cannot_say_that_it_differs_from_none(lab, planar2):
    # Known truth: a Coulomb torque far above the noise, so that the size of the bristle's torque is certain.
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -0.5 * np.sign(motion.v) * [0.0, 1.0]),))
    term = prepared.term("presliding_friction", "elbow")
    found = prepared.search.held_out_fit(frozenset([term]))
    certain, names = nearest_case_at_shape(planar2, term, found)
    assert (names, certain) == ((), pytest.approx(1.0, abs=1e-3))
    assert nearest_case_at_shape(planar2, term, found, ("coulomb_friction",)) is None


@pytest.mark.parametrize(("excess", "ratio"), [(9.0 / 4.0, 4.0 / 13.0), (-0.2, None), (0.9, None), (-0.6, 2.5)])
def test_a_torque_constant_is_plausible_between_a_half_and_two(quiet, excess, ratio):
    fault = implausible_size(quiet.session, quiet.term("torque_constant", "elbow"), np.array([excess]))
    assert (None if fault is None else fault[1]) == (ratio if ratio is None else pytest.approx(ratio))


@pytest.mark.parametrize(
    ("ratio", "std", "expected"), [(2.0, 0.0, 4.0), (0.75, 0.0, 1.0), (1.0, 0.0, 0.0), (1.5, 0.05, 1.0 / 1.01)]
)
def test_a_torque_constant_is_the_rarer_the_nearer_it_is_to_an_end_of_its_range(quiet, ratio, std, expected):
    # Closed form: the ends, a half and two, are two deviations from one; the excess is 1 / ratio - 1.
    excess, cov = np.array([1.0 / ratio - 1.0]), np.array([[(std / ratio**2) ** 2]])
    found = rarity(quiet.session, quiet.term("torque_constant", "elbow"), excess, cov)
    assert found == pytest.approx(expected, rel=0.01)


def test_a_size_of_an_effect_that_is_there_or_not_is_never_rare(quiet):
    assert rarity(quiet.session, quiet.term("coulomb_friction", "elbow"), np.array([50.0]), np.zeros((1, 1))) == 0.0


def test_a_rare_size_lowers_the_probability_by_its_prior():
    # Closed form: exp(-1.5) to one.
    found = weighted_by_rarity(np.array([0.5, 0.5]), np.array([4.0, 1.0]))
    np.testing.assert_allclose(found, [np.exp(-1.5) / (1.0 + np.exp(-1.5)), 1.0 / (1.0 + np.exp(-1.5))])


@pytest.mark.parametrize(("deviation", "possible"), [(0.0, False), (0.05, False), (0.15, True)])
def test_a_size_whose_interval_reaches_into_its_range_may_be_plausible(quiet, deviation, possible):
    # Closed form: a size a fifth above the end of its range; two deviations of 0.15 reach into it, of 0.05 they do not.
    most = 2.0 * float(quiet.session.largest_torque[1])
    cov = np.array([[(deviation * most) ** 2]])
    fault = implausible_size(quiet.session, quiet.term("coulomb_friction", "elbow"), np.array([1.2 * most]), cov)
    assert (fault is None) is possible


@pytest.mark.parametrize(("effect", "by_speed"), [("coulomb_friction", False), ("viscous_friction", True)])
def test_no_drive_moves_a_joint_against_twice_the_torque_that_it_ever_gave(quiet, effect, by_speed):
    # By hand: twice the largest torque of the elbow, for viscous friction over its largest speed.
    (log,) = quiet.session.logs
    most = 2.0 * np.abs(log.tau[:, 1]).max() / (np.abs(log.motion.v[log.samples, 1]).max() if by_speed else 1.0)
    term = quiet.term(effect, "elbow")
    assert implausible_size(quiet.session, term, np.array([0.99 * most])) is None
    fault = implausible_size(quiet.session, term, np.array([1.01 * most]))
    assert fault is not None
    parameter, value = fault
    assert parameter.plausible is not None
    assert parameter.plausible[1] == pytest.approx(most)
    assert value == pytest.approx(1.01 * most)


def test_what_is_no_friction_has_no_range_by_the_recorded_torque(quiet):
    # A spring may hold more than the drive does.
    term = quiet.term("torque_offset", "elbow")
    assert implausible_size(quiet.session, term, np.array([5.0 * quiet.session.largest_torque[1]])) is None


@pytest.fixture(scope="module")
def made(lab, planar2):
    """Friction on both joints and an offset on one that the model lacks."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.7, 1.0] + np.array([0.4, 0.0])
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def steps(search) -> tuple[frozenset, int]:
    """What forward selection finds, and in how many steps."""
    said: list[str] = []
    return forward_selection(search, frozenset(), said.append), len(said)


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
    known = {term.effect_joint for term in made.search.terms}
    chosen = frozenset(made.term(*place) for place in (*needed, *needless) if place in known)
    assert len(chosen) > 4
    monkeypatch.setattr(claims, "_MOST_TRIED", tried)
    assert {term.effect_joint for term in backward_elimination(made.search, chosen)} == set(needed)


@pytest.fixture
def passes(monkeypatch) -> list[int]:
    """How many effects there are at each pass of elimination."""
    seen: list[int] = []
    plain = claims.least_needed
    monkeypatch.setattr(claims, "least_needed", lambda *given: seen.append(len(given[1])) or plain(*given))
    return seen


def test_needless_effects_of_different_joints_go_in_one_pass_and_are_the_same(made, monkeypatch, passes):
    needed = [("coulomb_friction", "shoulder"), ("coulomb_friction", "elbow"), ("torque_offset", "shoulder")]
    needless = [("viscous_friction", "shoulder"), ("torque_offset", "elbow")]
    chosen = frozenset(made.term(*place) for place in (*needed, *needless))
    one_by_one = backward_elimination(made.search, chosen)
    assert passes == [5, 4, 3]
    passes.clear()
    monkeypatch.setattr(search_module, "_MANY_JOINTS", 0)
    assert backward_elimination(made.search, chosen) == one_by_one
    assert passes == [5, 3]


def test_effects_of_different_joints_are_swapped_in_one_pass_and_are_the_same(made, monkeypatch):
    wrong = frozenset(made.term("viscous_friction", joint) for joint in ("shoulder", "elbow"))
    chosen = wrong | {made.term("torque_offset", "shoulder")}
    tried: list[frozenset] = []
    monkeypatch.setattr(
        swaps, "backward_elimination", lambda search, some: tried.append(some) or backward_elimination(search, some)
    )
    one_by_one = with_swaps(made.search, chosen)
    assert len(tried) == 2
    tried.clear()
    monkeypatch.setattr(search_module, "_MANY_JOINTS", 0)
    assert with_swaps(made.search, chosen) == one_by_one
    assert len(tried) == 1
    assert {term.effect_joint for term in one_by_one} >= {
        ("coulomb_friction", "shoulder"),
        ("coulomb_friction", "elbow"),
    }
