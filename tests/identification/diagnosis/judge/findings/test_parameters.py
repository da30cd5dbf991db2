import numpy as np
import pytest

from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.joint_fit import joint_fit
from identification.diagnosis.judge.findings.parameters import _named, finding_loadings, finding_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Parameter
from phantom_dyn.errors import ChainError
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
    fitted = joint_fit(loaded.problem, terms, fit(loaded.problem, terms, held_out=False))
    return fitted, [finding_parameters(planar2, term, fitted) for term in terms]


def test_a_linear_parameter_has_the_deviation_of_its_coefficient(loaded, planar2):
    term = loaded.term("coulomb_friction", "elbow")
    fitted, (friction, _) = estimates(loaded, planar2, term, loaded.term("payload", None))
    at = fitted.place(term).coefficients.start
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
    at = fitted.place(term).coefficients.start + np.array([0, 3])
    cov = fitted.cov[np.ix_(at, at)]
    m, h = fitted.x[at]
    c = h / m
    expected = np.sqrt(cov[1, 1] - 2 * c * cov[0, 1] + c**2 * cov[0, 0]) / m
    assert values["center_z"].std == pytest.approx(expected, rel=0.01)


def test_the_deviation_of_a_ratio_is_that_of_its_inverse(loaded, planar2):
    # Closed form: ratio = 1 / (1 + e), so its deviation is that of e times ratio squared.
    term = loaded.term("torque_constant", "elbow")
    fitted, (values,) = estimates(loaded, planar2, term)
    at = fitted.place(term).coefficients.start
    ratio = values["ratio"]
    assert ratio.std == pytest.approx(ratio.value**2 * np.sqrt(fitted.cov[at, at]), rel=0.01)


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
        lab.acting(planar2, motion, effect.name, joint, *fitted.x[fitted.place(term).coefficients]),
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
    all_of_them = fitted.x[fitted.place(term).coefficients]
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
    np.testing.assert_allclose(np.sqrt((loadings**2).sum(axis=1)), deviations(values), rtol=1e-6, atol=1e-12)


def test_loadings_of_two_findings_have_the_covariance_of_the_fit(loaded, planar2):
    terms = (loaded.term("coulomb_friction", "elbow"), loaded.term("viscous_friction", "elbow"))
    fitted, _ = estimates(loaded, planar2, *terms)
    (one,), (two,) = (np.array(finding_loadings(planar2, term, fitted)) for term in terms)
    at = [fitted.place(term).coefficients.start for term in terms]
    assert one @ two == pytest.approx(fitted.cov[at[0], at[1]], rel=1e-6)


def test_lists_of_parameters_hold_one_number_for_each_wave():
    # By hand: three parameters of two waves, one list after the other.
    parameters = tuple(Parameter(name, unit) for name, unit in (("order", "1"), ("amplitude", "N m"), ("phase", "rad")))
    found = _named(parameters, np.arange(6.0), 0.1 * np.arange(6.0), lists=True)
    assert {name: (value.value, value.unit) for name, value in found.items()} == {
        "order": ([0.0, 1.0], "1"),
        "amplitude": ([2.0, 3.0], "N m"),
        "phase": ([4.0, 5.0], "rad"),
    }
    assert found["phase"].std == pytest.approx([0.4, 0.5])


def test_one_wave_is_a_list_of_one_number_for_each_parameter():
    # The contract: orders, amplitudes and phases are lists.
    parameters = tuple(Parameter(name, "1") for name in ("order", "amplitude", "phase"))
    found = _named(parameters, np.array([8.0, 0.1, 0.4]), np.zeros(3), lists=True)
    assert [value.value for value in found.values()] == [[8.0], [0.1], [0.4]]
    assert [value.std for value in found.values()] == [[0.0]] * 3
