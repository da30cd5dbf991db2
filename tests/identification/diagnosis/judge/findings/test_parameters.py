"""Parts whose absence explains inertial parameters. Oracle: the products of Pinocchio's parameters, by hand.

Deviations of sizes beside other causes. Oracle: the law of total variance.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.changes import KnownPayload, with_payload
from identification.diagnosis.columns.terms import ordered
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.full_fit import full_fit
from identification.diagnosis.judge.findings.findings import center_notes
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.diagnosis.judge.findings.missing_parts import (
    bodies_expressing_part,
    likeliest_missing_part,
    missing_part_notes,
    missing_part_shares,
    payload_term,
)
from identification.diagnosis.judge.findings.parameters import (
    _values_by_name,
    finding_loadings,
    finding_parameters,
    sum_notes,
)
from identification.diagnosis.judge.findings.shown_numbers import widened_by_rivals
from identification.diagnosis.judge.judged_band import plain_search
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.gates.special_case import more_than_a_missing_part
from identification.words.note_words import sentences
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Parameter
from phantom_dyn.errors import ChainError
from phantom_dyn.model.attached import Attached
from phantom_dyn.model.inertia import point_mass_parameters
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion


@pytest.fixture(scope="module")
def loaded(lab, planar2):
    """The arm with a load of 0.6 kg, 0.35 m below the elbow, and friction on the elbow."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = lab.acting(planar2, motion, "payload", None, 0.6, 0.0, 0.0, -0.35)
    torque = torque - 0.3 * np.sign(motion.v) * [0.0, 1.0]
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),), white=False)


def estimates(loaded, planar2, *terms):
    fitted = full_fit(loaded.problem, terms, fit(loaded.problem, terms, held_out=False))
    return fitted, [finding_parameters(planar2, term, fitted) for term in terms]


def test_a_linear_parameter_has_the_deviation_of_its_coefficient(loaded, planar2):
    term = loaded.term("coulomb_friction", "elbow")
    fitted, (friction, _) = estimates(loaded, planar2, term, loaded.term("payload", None))
    at = fitted.slices_of(term).coefficients.start
    assert friction["torque"].value == fitted.x[at]
    assert friction["torque"].std == pytest.approx(np.sqrt(fitted.cov[at, at]), rel=1e-3)
    assert friction["torque"].unit == "N m"


def test_known_values_lie_within_three_deviations(loaded, planar2):
    terms = (loaded.term("coulomb_friction", "elbow"), loaded.term("payload", None))
    _, (friction, payload) = estimates(loaded, planar2, *terms)
    truth = {"torque": 0.3, "mass": 0.6, "center_x": 0.0, "center_z": -0.35}
    for name, value in truth.items():
        got = {**friction, **payload}[name]
        assert abs(got.value - value) < 3 * got.std + 1e-3


def test_a_place_has_the_deviation_of_a_quotient(loaded, planar2):
    # Closed form: c = h / m, var c = (var h - 2 c cov(h, m) + c^2 var m) / m^2.
    term = loaded.term("payload", None)
    fitted, (values,) = estimates(loaded, planar2, term)
    at = fitted.slices_of(term).coefficients.start + np.array([0, 3])
    cov = fitted.cov[np.ix_(at, at)]
    m, h = fitted.x[at]
    c = h / m
    expected = np.sqrt(cov[1, 1] - 2 * c * cov[0, 1] + c**2 * cov[0, 0]) / m
    assert values["center_z"].std == pytest.approx(expected, rel=0.01)


def test_the_deviation_of_a_ratio_is_that_of_its_inverse(loaded, planar2):
    # Closed form: ratio = 1 / (1 + e), so its deviation is that of e times ratio squared.
    term = loaded.term("torque_constant", "elbow")
    fitted, (values,) = estimates(loaded, planar2, term)
    at = fitted.slices_of(term).coefficients.start
    ratio = values["ratio"]
    assert ratio.std == pytest.approx(ratio.value**2 * np.sqrt(fitted.cov[at, at]), rel=0.01)


def test_a_number_with_the_deviation_of_its_prior_is_not_shown(loaded, planar2):
    # By geometry: both axes are along y, so that the place along y leaves no torque. A deviation of 1.7 m is no number.
    terms = (loaded.term("payload", None), loaded.term("inertial_parameters", "elbow"))
    for term in terms:
        _, (values,) = estimates(loaded, planar2, term)
        unshown = {name for name, value in values.items() if not value.shown}
        assert unshown == ({"center_y"} if term is terms[0] else set())


@pytest.mark.parametrize(("share", "shown"), [(1.0, False), (0.3, False), (0.2, True)])
def test_a_number_is_shown_if_the_recording_tells_more_than_the_prior(loaded, planar2, share, shown):
    # Closed form: the variance is a share of that of the prior, and a quarter is half the deviation.
    term = loaded.term("coulomb_friction", "elbow")
    fitted, _ = estimates(loaded, planar2, term)
    fitted = replace(fitted, prior=np.diag(fitted.cov) / share)
    assert finding_parameters(planar2, term, fitted)["torque"].shown == shown


def test_the_centre_in_a_note_is_the_one_that_a_known_payload_needs(loaded, planar2):
    # Oracle: a known payload with the numbers of the note has the torques of the finding.
    term = loaded.term("payload", None)
    fitted, (values,) = estimates(loaded, planar2, term)
    assert not center_notes(stated_on(planar2, term, fitted))
    model, elbow = planar2.model.copy(), planar2.model.getJointId("elbow")
    place = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.pi / 2, 0.3), np.array([0.1, 0.0, -0.4]))
    model.addFrame(pin.Frame("tool", elbow, 0, place, pin.FrameType.OP_FRAME))
    robot = replace(planar2, model=model, payload_frame="tool")
    (note,) = center_notes(stated_on(robot, term, fitted))
    assert (note.joint, note.numbers["frame"]) == ("elbow", "tool")
    known = with_payload(robot, KnownPayload(values["mass"].value, tuple(note.numbers["center"])))
    center = [values[f"center_{axis}"].value for axis in "xyz"]
    added = (standard_parameters(known) - standard_parameters(robot)).reshape(-1, 10)[elbow - 1]
    np.testing.assert_allclose(added, point_mass_parameters(values["mass"].value, np.array(center)), atol=1e-9)
    written = sentences((note,))[0].rpartition("center: [")[2].removesuffix("].")
    np.testing.assert_allclose([float(x) for x in written.split(", ")], note.numbers["center"], atol=6e-5)


def stated_on(robot, term, fitted):
    """As much of the shown findings as notes on centres need."""
    problem = SimpleNamespace(session=SimpleNamespace(robot=robot))
    return SimpleNamespace(problem=problem, named=frozenset([term]), full_fit=fitted)


@pytest.mark.parametrize("joint", ["elbow", None])
def test_base_parameters_alone_predict_what_all_of_them_do(loaded, planar2, lab, joint):
    # Known property of base parameters: with the others unchanged the torque is the same on any motion.
    term = loaded.term("inertial_parameters", joint)
    fitted, (values,) = estimates(loaded, planar2, term)
    effect = effect_named("inertial_parameters")
    names = [p.name for p in effect.parameters(planar2, joint)]
    alone = np.array([values[name].value if name in values else 0.0 for name in names])
    motion = lab.motion(2, 77, seconds=2.0)
    np.testing.assert_allclose(
        lab.acting(planar2, motion, effect.name, joint, *alone),
        lab.acting(planar2, motion, effect.name, joint, *fitted.x[fitted.slices_of(term).coefficients]),
        atol=1e-8,
    )


def swing(seconds: float, size: float) -> Motion:
    t = np.arange(int(100 * seconds)) / 100
    w = np.array([1.0, 2.3, 5.1])
    waves = np.outer(t, w)
    q, v, a = (size * x.sum(axis=1)[:, None] for x in (np.sin(waves), w * np.cos(waves), -(w**2) * np.sin(waves)))
    return Motion(t, q, v, a)


def test_base_parameters_of_a_linkage_that_does_not_turn_round_predict_too(lab, robots):
    # Known property of base parameters. The crank of this four-bar reaches little of a turn.
    robot = load_robot(robots / "fourbar.xml")
    with pytest.raises(ChainError, match="cannot be closed"):
        robot.solutions.at(np.array([[3.0]]))
    motion = swing(20.0, 0.2)
    torque = -0.3 * motion.a
    case = lab.prepared(robot, (lab.recording(robot, motion, torque),), white=False)
    term = case.term("inertial_parameters", "drive")
    fitted, (values,) = estimates(case, robot, term)
    names = [p.name for p in effect_named("inertial_parameters").parameters(robot, "drive")]
    alone = np.array([values[name].value if name in values else 0.0 for name in names])
    assert 0 < len(values) < len(names)
    other = swing(3.0, 0.15)
    all_of_them = fitted.x[fitted.slices_of(term).coefficients]
    torques = [lab.acting(robot, other, "inertial_parameters", "drive", *theta) for theta in (alone, all_of_them)]
    np.testing.assert_allclose(*torques, atol=1e-6 * np.abs(torques[1]).max())


def test_of_inertial_parameters_those_are_given_that_a_motion_can_tell(loaded, planar2):
    # In the plane a link has four: what it weighs on the joint before, two first moments, and one inertia.
    _, (values,) = estimates(loaded, planar2, loaded.term("inertial_parameters", "elbow"))
    assert len(values) == 4
    assert all(value.std > 0 for value in values.values())


def deviations(values) -> np.ndarray:
    return np.concatenate([np.atleast_1d(value.std) for value in values.values()])


@pytest.mark.parametrize(
    ("effect", "joint"),
    [
        ("coulomb_friction", "elbow"),
        ("payload", None),
        ("stribeck_friction", "elbow"),
        ("inertial_parameters", "elbow"),
    ],
)
def test_loadings_have_the_deviations_of_the_parameters(loaded, planar2, effect, joint):
    term = loaded.term(effect, joint)
    fitted, (values,) = estimates(loaded, planar2, term)
    loadings = np.array(finding_loadings(planar2, term, fitted))
    shown = np.isfinite(deviations(values))
    lengths = np.sqrt((loadings**2).sum(axis=1))
    np.testing.assert_allclose(lengths[shown], deviations(values)[shown], rtol=1e-6, atol=1e-12)
    assert shown.sum() >= min(len(shown), 2)


def test_loadings_of_two_findings_have_the_covariance_of_the_fit(loaded, planar2):
    terms = (loaded.term("coulomb_friction", "elbow"), loaded.term("viscous_friction", "elbow"))
    fitted, _ = estimates(loaded, planar2, *terms)
    (one,), (two,) = (np.array(finding_loadings(planar2, term, fitted)) for term in terms)
    at = [fitted.slices_of(term).coefficients.start for term in terms]
    assert one @ two == pytest.approx(fitted.cov[at[0], at[1]], rel=1e-6)


def test_lists_of_parameters_hold_one_number_for_each_wave():
    # By hand: three parameters of two waves, one list after the other.
    parameters = tuple(Parameter(name, unit) for name, unit in (("order", "1"), ("amplitude", "N m"), ("phase", "rad")))
    found = _values_by_name(parameters, np.arange(6.0), 0.1 * np.arange(6.0), lists=True)
    assert {name: (value.value, value.unit) for name, value in found.items()} == {
        "order": ([0.0, 1.0], "1"),
        "amplitude": ([2.0, 3.0], "N m"),
        "phase": ([4.0, 5.0], "rad"),
    }
    assert found["phase"].std == pytest.approx([0.4, 0.5])


def test_one_wave_is_a_list_of_one_number_for_each_parameter():
    # The contract: orders, amplitudes and phases are lists.
    parameters = tuple(Parameter(name, "1") for name in ("order", "amplitude", "phase"))
    found = _values_by_name(parameters, np.array([8.0, 0.1, 0.4]), np.zeros(3), lists=True)
    assert [value.value for value in found.values()] == [[8.0], [0.1], [0.4]]
    assert [value.std for value in found.values()] == [[0.0]] * 3


PLACE = "identification.diagnosis.judge.findings.missing_parts."
HAND = Attached(("hand", "gripper"), 0.6, np.array([0.0, 0.1, -0.4]), np.diag([0.002, 0.003, 0.004]))
RING = Attached(("ring",), 0.1, np.array([0.0, 0.0, 0.2]), np.diag([1e-4, 1e-4, 2e-4]))


def parameters(part: Attached) -> np.ndarray:
    """Ten parameters of a body, in the order of Pinocchio."""
    return pin.Inertia(part.mass, part.center, part.inertia).toDynamicParameters()


@pytest.fixture
def handed(planar2, rng):
    """Two links with a ring on the first and a hand on the last, and products of their twenty columns."""
    robot = SimpleNamespace(model=planar2.model, attached=((), (RING,), (HAND,)))
    root = rng.normal(size=(30, 40))
    products = SimpleNamespace(session=SimpleNamespace(robot=robot), nuisance_count=3, total_a=root @ root.T)
    everything = SimpleNamespace(columns=tuple(range(3, 23)))
    return products, everything


@pytest.mark.parametrize("left", [0.0, 0.2])
def test_the_part_is_found_whose_absence_makes_most_of_the_torque(handed, left, rng):
    # By hand: what is left of the squares of the torque when the part is put back.
    problem, term = handed
    rest = left * rng.normal(size=20)
    own = rest - np.concatenate([np.zeros(10), parameters(HAND)])
    share, body, part = likeliest_missing_part(problem, term, own)
    a = problem.total_a[3:23, 3:23]
    assert (body, part) == (2, HAND)
    assert share == pytest.approx(1.0 - (rest @ a @ rest) / (own @ a @ own))


def test_a_part_of_the_first_link_is_found_too(handed):
    problem, term = handed
    share, body, part = likeliest_missing_part(problem, term, np.concatenate([-parameters(RING), np.zeros(10)]))
    assert (share, body, part) == (pytest.approx(1.0), 1, RING)


def test_columns_of_some_links_alone_have_their_own_place(handed):
    problem, _ = handed
    last = SimpleNamespace(columns=tuple(range(13, 23)))
    assert likeliest_missing_part(problem, last, -parameters(HAND))[0] == pytest.approx(1.0)


def test_a_robot_without_such_parts_lacks_none(handed):
    problem, term = handed
    problem.session.robot.attached = ((), (), ())
    assert likeliest_missing_part(problem, term, np.ones(20)) is None
    assert missing_part_notes(problem, term, np.ones(20)) == []


@pytest.mark.parametrize(("share", "said"), [(0.74, False), (0.75, True), (0.994, True)])
def test_a_part_is_reported_that_explains_three_quarters(planar2, monkeypatch, share, said):
    monkeypatch.setattr(PLACE + "likeliest_missing_part", lambda *_: (share, 2, HAND))
    words = sentences(missing_part_notes(SimpleNamespace(), SimpleNamespace(joint=None), np.zeros(20)))
    assert len(words) == said
    if said:
        assert words[0].startswith(
            f"Of what the wrong inertial parameters explain, {round(100 * share)} % would be explained"
        )
        assert (
            "if the robot lacked hand and gripper (0.6 kg), which the model carries on a fixed or locked joint"
            in words[0]
        )


CASES = [(0.89, 2, False), (0.9, 2, True), (0.99, 1, False)]


@pytest.mark.parametrize(("share", "body", "taken"), CASES)
def test_a_payload_says_it_where_nine_tenths_are_a_part_of_its_link(quiet, monkeypatch, share, body, taken):
    monkeypatch.setattr(PLACE + "likeliest_missing_part", lambda *_: (share, body, HAND))
    rich, other = quiet.term("inertial_parameters", None), quiet.term("coulomb_friction", "elbow")
    fitted = SimpleNamespace(coefficients=lambda term: np.zeros(len(term.columns)))
    found = missing_part_shares(quiet.search, (other, rich), fitted)
    assert {term: not more_than_a_missing_part(part).passed for term, part in found.items()} == {rich: taken}
    assert payload_term(quiet.search) == quiet.term("payload", None)
    assert missing_part_shares(quiet.search, (other,), fitted) == {}


@pytest.mark.parametrize(("share", "body", "taken"), CASES)
def test_inertial_parameters_that_say_the_same_as_a_payload_are_named(quiet, monkeypatch, share, body, taken):
    monkeypatch.setattr(PLACE + "likeliest_missing_part", lambda *_: (share, body, HAND))
    payload = quiet.term("payload", None)
    found = bodies_expressing_part(quiet.search, frozenset([payload]), payload)
    rich = {term.effect_joint for term in quiet.search.terms if term.effect.inertial == "free"}
    assert rich
    assert found == (rich if taken else frozenset())


@pytest.fixture
def rubbing(lab, planar2):
    """Coulomb and viscous friction of the elbow are shown: sets of them by name, and what is shown."""
    motion = lab.motion(2, seconds=20.0)
    torque = lab.acting(planar2, motion, "coulomb_friction", "elbow", 0.5)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    coulomb, viscous = (prepared.term(name, "elbow") for name in ("coulomb_friction", "viscous_friction"))
    plain = plain_search(prepared.search, prepared.noise)
    chosen = frozenset([coulomb])
    fit = full_fit(plain.problem.of(chosen), ordered(chosen), plain.held_out_fit(chosen))
    return coulomb, frozenset([coulomb, viscous]), ShownEffects(plain.of(chosen), chosen, fit, {}, chosen)


def test_a_size_is_uncertain_by_what_it_is_beside_a_likely_rival(rubbing):
    # Closed form: a variance of p (x' - x)^2 on top of its own.
    coulomb, both, shown = rubbing
    shown = replace(shown, comparisons={coulomb: RivalComparison(0.7, (), rival_sets=((both, 0.3),))})
    column, at = coulomb.columns[0], shown.full_fit.slices_of(coulomb).coefficients.start
    shift = shown.plain.held_out_fit(both).theta[column] - shown.plain.held_out_fit(shown.chosen).theta[column]
    assert abs(shift) > 0.0
    more = widened_by_rivals(shown.full_fit, shown).cov[at, at] - shown.full_fit.cov[at, at]
    assert more == pytest.approx(0.3 * shift**2)


def test_a_set_that_is_a_rival_of_two_findings_counts_once(rubbing):
    # Closed form: the larger of its two probabilities.
    coulomb, both, shown = rubbing
    (viscous,) = both - {coulomb}
    once, twice = (
        replace(shown, comparisons={term: RivalComparison(0.7, (), rival_sets=((both, p),)) for term, p in shares})
        for shares in (((coulomb, 0.3),), ((coulomb, 0.3), (viscous, 0.2)))
    )
    np.testing.assert_array_equal(*(widened_by_rivals(one.full_fit, one).cov for one in (once, twice)))


def test_without_rivals_deviations_stay_as_they_are(rubbing):
    coulomb, _, shown = rubbing
    shown = replace(shown, comparisons={coulomb: RivalComparison(1.0, ())})
    assert widened_by_rivals(shown.full_fit, shown) is shown.full_fit


def test_a_rival_that_has_not_the_effect_says_nothing_of_its_size(rubbing):
    coulomb, both, shown = rubbing
    shown = replace(shown, comparisons={coulomb: RivalComparison(0.7, (), rival_sets=((both - {coulomb}, 0.3),))})
    np.testing.assert_array_equal(widened_by_rivals(shown.full_fit, shown).cov, shown.full_fit.cov)


def test_a_note_gives_the_sums_that_base_parameters_stand_for(loaded, planar2):
    # Oracle: closed form. What hangs at the end of the upper link, 0.5 m from its joint, adds to its inertia.
    (note,) = sum_notes(planar2, loaded.term("inertial_parameters", None))
    assert note.numbers["sums"] == {
        "shoulder.mz": "shoulder.mz - 0.5 elbow.m",
        "shoulder.Iyy": "shoulder.Iyy + 0.25 elbow.m",
    }
    assert sum_notes(planar2, loaded.term("inertial_parameters", "elbow")) == ()
