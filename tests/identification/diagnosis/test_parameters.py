from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.findings import neighbours_of
from identification.diagnosis.fitting import fit
from identification.diagnosis.parameters import Neighbour, finding_parameters
from identification.diagnosis.terms import FoundEffect
from phantom_dyn.effects.catalogue import effect_named


@pytest.fixture(scope="module")
def loaded(lab, planar2):
    """The arm with a load of 0.6 kg, 0.35 m below the elbow, and friction on the elbow."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = lab.acting(planar2, motion, "payload", None, 0.6, 0.0, 0.0, -0.35)
    torque = torque - 0.3 * np.sign(motion.v) * [0.0, 1.0]
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def estimates(loaded, planar2, *terms):
    found = fit(loaded.problem, terms)
    return found, [finding_parameters(planar2, term, found) for term in terms]


def test_a_linear_parameter_has_the_deviation_of_its_coefficient(loaded, planar2):
    term = loaded.term("coulomb_friction", "elbow")
    found, (friction, _) = estimates(loaded, planar2, term, loaded.term("payload", None))
    at = int(np.searchsorted(found.active, term.columns[0]))
    assert friction["torque"].value == found.theta[term.columns[0]]
    assert friction["torque"].std == pytest.approx(np.sqrt(found.cov[at, at]), rel=1e-3)
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
    found, (values,) = estimates(loaded, planar2, term)
    at = np.searchsorted(found.active, term.columns)
    cov = found.cov[np.ix_(at[[0, 3]], at[[0, 3]])]
    m, h = found.theta[term.columns[0]], found.theta[term.columns[3]]
    c = h / m
    expected = np.sqrt(cov[1, 1] - 2 * c * cov[0, 1] + c**2 * cov[0, 0]) / m
    assert values["center_z"].std == pytest.approx(expected, rel=0.01)


def test_the_deviation_of_a_ratio_is_that_of_its_inverse(loaded, planar2):
    # Closed form: ratio = 1 / (1 + e), so its deviation is that of e times ratio squared.
    term = loaded.term("torque_constant", "elbow")
    found, (values,) = estimates(loaded, planar2, term)
    at = int(np.searchsorted(found.active, term.columns[0]))
    ratio = values["ratio"]
    assert ratio.std == pytest.approx(ratio.value**2 * np.sqrt(found.cov[at, at]), rel=0.01)


STRIBECK_VELOCITY = 0.2


@pytest.fixture(scope="module")
def slipping(lab, planar2):
    """The arm with friction on the elbow that falls from 0.9 to 0.3 N m at 0.2 rad/s; the shapes tried are near it."""
    motion = lab.motion(2, 4, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "stribeck_friction", "elbow", 0.3, 0.9, STRIBECK_VELOCITY)
    near = FoundEffect(effect_named("stribeck_friction"), "elbow", (0.21,), np.array([0.3, 0.6]))
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),), found=(near,))


def shape_of(slipping, planar2, neighbours):
    """The Stribeck velocity that neighbours on a made-up loss give to the term in the middle."""
    terms = [term for term in slipping.columns.terms if term.place == ("stribeck_friction", "elbow")]
    term = sorted(terms, key=lambda term: term.shape)[len(terms) // 2]
    found = fit(slipping.problem, (term,))
    made = tuple(
        Neighbour(shape, found.objective + rise, found.theta[list(term.columns)])
        for shape, rise in neighbours(term.shape[0])
    )
    return term.shape[0], finding_parameters(planar2, term, found, made)["stribeck_velocity"]


@pytest.mark.parametrize(("low", "high"), [(0.85, 1.18), (0.7, 1.1)])
@pytest.mark.parametrize("best", [1.0, 0.95, 1.05])
def test_a_shape_is_the_lowest_point_of_a_parabola_through_its_neighbours(slipping, planar2, low, high, best):
    # Closed form: a loss of ((x - x0) / sigma)^2 in squared deviations has its lowest point at x0, and x0 is known to
    # sigma; coefficients that do not follow the shape add nothing.
    sigma = 0.03

    def losses(middle):
        def at(x):
            return ((x - best * middle) ** 2 - (middle - best * middle) ** 2) / sigma**2

        return [(x * middle, at(x * middle)) for x in (low, high)]

    middle, value = shape_of(slipping, planar2, losses)
    assert value.value == pytest.approx(best * middle, rel=1e-6)
    assert value.std == pytest.approx(sigma, rel=1e-3)


def test_at_the_end_of_the_shapes_that_were_tried_half_of_the_value_is_its_deviation(slipping, planar2):
    middle, value = shape_of(slipping, planar2, lambda middle: [(1.18 * middle, 5.0)])
    assert value.value == middle
    assert value.std == pytest.approx(0.5 * middle, rel=1e-3)


def test_a_loss_that_does_not_tell_shapes_apart_leaves_them_as_uncertain_as_their_spacing(slipping, planar2):
    middle, value = shape_of(slipping, planar2, lambda middle: [(0.8 * middle, -1.0), (1.1 * middle, -1.0)])
    assert value.value == middle
    assert value.std == pytest.approx(0.2 * middle, rel=1e-3)


def test_a_known_shape_lies_within_three_deviations(slipping, planar2):
    # Known truth, with the neighbours that the diagnosis takes.
    terms = [term for term in slipping.columns.terms if term.place == ("stribeck_friction", "elbow")]
    best = min(terms, key=lambda term: fit(slipping.problem, (term,)).objective)
    neighbours = neighbours_of(slipping.search, frozenset([best]), best)
    assert len(neighbours) == len(terms) - 1
    values = finding_parameters(planar2, best, fit(slipping.problem, (best,)), neighbours)
    truth = {"coulomb_torque": 0.3, "static_torque": 0.9, "stribeck_velocity": STRIBECK_VELOCITY}
    for name, known in truth.items():
        assert abs(values[name].value - known) < 3 * values[name].std
    assert values["stribeck_velocity"].std < 0.1 * STRIBECK_VELOCITY


@pytest.mark.parametrize("joint", ["elbow", None])
def test_base_parameters_alone_predict_what_all_of_them_do(loaded, planar2, lab, joint):
    # Known property of base parameters: with the others unchanged the torque is the same on any motion.
    term = loaded.term("inertial_parameters", joint)
    found, (values,) = estimates(loaded, planar2, term)
    effect = effect_named("inertial_parameters")
    names = [p.name for p in effect.parameters(planar2, joint)]
    alone = np.array([values[name].value if name in values else 0.0 for name in names])
    motion = lab.motion(2, 77, seconds=2.0)
    np.testing.assert_allclose(
        lab.acting(planar2, motion, effect.name, joint, *alone),
        lab.acting(planar2, motion, effect.name, joint, *found.theta[list(term.columns)]),
        atol=1e-8,
    )


def test_of_inertial_parameters_those_are_given_that_a_motion_can_tell(loaded, planar2):
    # In the plane a link has four: what it weighs on the joint before, two first moments, and one inertia.
    _, (values,) = estimates(loaded, planar2, loaded.term("inertial_parameters", "elbow"))
    assert len(values) == 4
    assert all(value.std > 0 for value in values.values())
