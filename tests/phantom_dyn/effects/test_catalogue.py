import inspect
import re
from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.described import ModelNumbers
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.effects.user import trial
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.motion import Motion

REGIMES = {
    "velocity_reversal", "low_speed", "high_speed", "high_load", "high_acceleration", "one_direction",
    "periodic_in_angle", "posture", "saturated", "time_drift", "everywhere",
}  # fmt: skip
# The contract's parameters in order, with the unit on a hinge and on a slide.
PARAMETERS = {
    "viscous_friction": {"coefficient": ("N m s/rad", "N s/m")},
    "coulomb_friction": {"torque": ("N m", "N")},
    "direction_dependent_friction": {
        "torque_positive": ("N m", "N"),
        "torque_negative": ("N m", "N"),
        "coefficient_positive": ("N m s/rad", "N s/m"),
        "coefficient_negative": ("N m s/rad", "N s/m"),
    },
    "stribeck_friction": {
        "coulomb_torque": ("N m", "N"),
        "static_torque": ("N m", "N"),
        "stribeck_velocity": ("rad/s", "m/s"),
    },
    "presliding_friction": {
        "torque": ("N m", "N"),
        "displacement": ("rad", "m"),
        "coulomb_torque": ("N m", "N"),
    },
    "load_dependent_friction": {"ratio": ("1", "1")},
    "temperature_dependent_friction": {
        "coulomb_torque": ("N m", "N"),
        "coefficient": ("N m s/rad", "N s/m"),
        "torque_slope": ("N m/°C", "N/°C"),
        "coefficient_slope": ("N m s/(rad °C)", "N s/(m °C)"),
        "reference_temperature": ("°C", "°C"),
    },
    "position_dependent_friction": {"position": ("rad", "m"), "torque": ("N m", "N")},
    "cogging": {"order": ("1", "rad/m"), "amplitude": ("N m", "N"), "phase": ("rad", "rad")},
    "torque_ripple": {"order": ("1", "rad/m"), "amplitude": ("1", "1"), "phase": ("rad", "rad")},
    "torque_saturation": {"limit": ("N m", "N")},
    "input_delay": {"delay": ("s", "s")},
    "actuator_lag": {"time_constant": ("s", "s")},
    "torque_offset": {"torque": ("N m", "N")},
    "torque_constant": {"ratio": ("1", "1")},
    "rotor_inertia": {"inertia": ("kg m^2", "kg")},
    "parasitic_spring": {"stiffness": ("N m/rad", "N/m"), "rest_position": ("rad", "m")},
}
ON_A_JOINT = [effect for effect in EFFECTS if effect.scope == "joint"]
ON_ONE_JOINT = [effect for effect in ON_A_JOINT if effect.name != "joint_coupling"]
# Effects of one joint that the drives of others have to make up for too.
SPREADING = {"inertial_parameters", "backlash", "transmission_compliance", "encoder_offset", "encoder_eccentricity",
             "encoder_quantization"}  # fmt: skip
# Effects whose columns are no more than the first order of their torque, and two that need a reference or rounding.
DEPARTING = {"base_tilt", "payload", "backlash", "transmission_compliance", "input_delay", "torque_saturation",
             "encoder_offset", "encoder_eccentricity", "encoder_quantization", "reference_delay"}  # fmt: skip
WAVES = {"cogging", "torque_ripple"}
# Effects whose parameters are their coefficients; others have a law of their own in the file of that effect.
LINEAR = [e for e in EFFECTS if e.name in {"viscous_friction", "coulomb_friction", "direction_dependent_friction",
                                           "torque_offset", "rotor_inertia", "inertial_parameters"}]  # fmt: skip


def name_of(effect: Effect) -> str:
    return effect.name


def test_names_are_unique():
    names = [effect.name for effect in EFFECTS]
    assert len(names) == len(set(names))


def test_names_are_words_joined_by_underscores():
    # As the contract writes them: they are keys of files and options of the command line.
    assert [effect.name for effect in EFFECTS if not re.fullmatch(r"[a-z]+(_[a-z]+)*", effect.name)] == []


def test_regimes_are_those_of_the_contract():
    assert {effect.regime for effect in EFFECTS} <= REGIMES == set(trial.REGIMES)


def test_an_effect_is_found_by_its_name():
    assert [effect.name for effect in EFFECTS if effect_named(effect.name) is not effect] == []


def test_an_unknown_effect_is_refused_with_the_known_names():
    with pytest.raises(ParameterError, match=r"Unknown effect 'magic': the effects are viscous_friction, coulomb_"):
        effect_named("magic")


@pytest.mark.parametrize(("joint", "kind"), [("turn", 0), ("slide", 1)])
def test_parameters_have_the_names_and_units_of_the_contract(arm, joint, kind):
    given = {name: [(p.name, p.unit) for p in effect_named(name).parameters(arm, joint)] for name in PARAMETERS}
    assert given == {name: [(p, units[kind]) for p, units in stated.items()] for name, stated in PARAMETERS.items()}


def test_an_unknown_joint_is_refused_with_the_known_names(arm, operation):
    for effect in ON_ONE_JOINT:
        shape = first_shape(effect, arm, operation, "turn")
        with pytest.raises(RobotError, match=r"No joint 'knee' in this robot: its joints are turn, tilt, slide\."):
            effect.signature(arm, operation, "knee", shape)


def test_places_are_joints_of_the_robot_each_once(arm):
    places = {effect.name: effect.places(arm) for effect in EFFECTS}
    assert [name for name, one in places.items() if not len(set(one)) == len(one) > 0] == []
    named = {joint for one in places.values() for place in one if place for joint in place.split("+")}
    assert named == set(arm.joint_names)


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.name not in DEPARTING], ids=name_of)
@pytest.mark.parametrize("joint", ["tilt", "slide"])
def test_the_drive_makes_up_for_the_torque_of_an_effect(arm, smooth, rng, effect, joint):
    # Measured torque = model + columns @ coefficients, and the effect's own torque is what the drive makes up for.
    place = joint if joint in effect.places(arm) else effect.places(arm)[-1]
    shape = (6.0, 24.5) if effect.name in WAVES else first_shape(effect, arm, smooth, place)
    signature = effect.signature(arm, smooth, place, shape)
    coefficients = rng.uniform(0.1, 0.5, len(signature.names))
    expected = np.zeros((len(smooth.t), 3))
    expected[:, list(signature.rows)] = -signature.columns @ coefficients
    assert expected.any()
    torque = effect.torque(arm, smooth, place, effect.from_coefficients(arm, place, coefficients, shape))
    np.testing.assert_allclose(torque, expected, atol=1e-11)


def test_the_coefficients_of_a_linear_effect_are_its_parameters(arm, rng):
    for effect in LINEAR:
        theta = rng.normal(size=len(effect.parameters(arm, "tilt")))
        np.testing.assert_array_equal(effect.from_coefficients(arm, "tilt", theta, ()), theta, err_msg=effect.name)


@pytest.mark.parametrize("effect", [e for e in ON_ONE_JOINT if e.name not in SPREADING], ids=name_of)
def test_an_effect_of_one_joint_touches_no_other(arm, operation, effect):
    shape = first_shape(effect, arm, operation, "tilt")
    assert effect.signature(arm, operation, "tilt", shape).rows == (1,)
    theta = effect.from_coefficients(arm, "tilt", effect.probe(arm, operation, "tilt")[1] * 0.5, shape)
    torque = effect.torque(arm, operation, "tilt", theta)
    assert np.all(torque[:, [0, 2]] == 0)
    assert np.any(torque[:, 1] != 0)


def at_last(effect, arm, operation):
    """The last place of an effect, a shape to look at, and its columns there."""
    place = effect.places(arm)[-1]
    shape = first_shape(effect, arm, operation, place)
    return place, shape, effect.signature(arm, operation, place, shape)


def test_columns_have_a_name_a_unit_and_no_more_bounds_than_there_are(arm, operation):
    for effect in EFFECTS:
        place, shape, signature = at_last(effect, arm, operation)
        assert signature.columns.shape == (40, len(signature.rows), len(signature.names)), effect.name
        assert len(signature.units) == len(signature.names), effect.name
        assert len(effect.coefficient_bounds(arm, place, shape)) in {0, len(signature.names)}, effect.name


@pytest.mark.parametrize("name", ["torque_saturation", "input_delay", "actuator_lag"])
def test_a_torque_sensor_behind_the_drive_does_not_show_what_the_drive_does(arm, smooth, name):
    effect = effect_named(name)
    why = effect.untestable(replace(arm, torque_source="sensor"), smooth, "tilt")
    assert re.search(r"behind the drive: the \w+ of the drive leaves no trace in them$", str(why))
    assert effect.untestable(arm, smooth, "tilt") is None


LISTS = {"cogging", "torque_ripple", "position_dependent_friction"}
# Effects whose torque is linear in the probed parameter about zero, with one number for each parameter.
PROBED = [e for e in EFFECTS if e.name in {*PARAMETERS, "payload"} - LISTS - {"torque_saturation", "input_delay"}]


@pytest.mark.parametrize("effect", PROBED, ids=name_of)
def test_the_probe_is_one_unit_of_the_named_parameter(arm, operation, effect):
    # Finite difference of the torque in that parameter, where the others are those of the probe.
    joint = "tilt" if effect.scope == "joint" else None
    shape = first_shape(effect, arm, operation, joint)
    name, direction = effect.probe(arm, operation, joint)
    names = [p.name for p in effect.parameters(arm, joint)]
    step = 1e-6
    none = effect.from_coefficients(arm, joint, 0.0 * direction, shape)
    some = effect.from_coefficients(arm, joint, step * direction, shape)
    start = np.where([n == name for n in names], none, some)
    change = (effect.torque(arm, operation, joint, some) - effect.torque(arm, operation, joint, start)) / step
    assert (some - none)[names.index(name)] == pytest.approx(step, rel=1e-5)
    signature = effect.signature(arm, operation, joint, shape)
    np.testing.assert_allclose(change[:, list(signature.rows)], -signature.columns @ direction, rtol=1e-4, atol=1e-5)


# Of effects that are tried where the residual asks for them: an order; first and last place, and how many.
UNASKED = {"cogging": (12.0,), "torque_ripple": (12.0,), "position_dependent_friction": (-1.0, 1.0, 5.0)}


def first_shape(effect, arm, motion, joint):
    """A shape to look at; where nothing asks for an effect of lists, any one."""
    return (effect.shapes(arm, motion, joint) or (UNASKED.get(effect.name),))[0]


# Made of the model's torque as well, but the joint fit treats them by themselves: a gain of all that is on a joint, and
# what a drive at its limit lacks, which the recorded command says.
SCALED = {"torque_constant", "torque_saturation"}


def moves_with(arm, smooth, other, kept, shapes=None) -> dict[str, bool]:
    """By effect, whether its columns are others in another operation; one shape for both, so that only they differ."""
    out = {}
    for effect in (effect for effect in EFFECTS if effect.name not in kept):
        joint = effect.places(arm)[-1]
        shape = (shapes or {}).get(effect.name) or first_shape(effect, arm, smooth, joint)
        one, two = (effect.signature(o.robot, o, joint, shape).columns for o in (smooth, other))
        out[effect.name] = bool(np.any(np.abs(one - two) > 1e-9))
    return out


def test_columns_move_with_the_inertias_of_the_model_where_the_effect_says_so(arm, smooth):
    heavier = with_parameters(arm, 0.2 * standard_parameters(arm))
    moved = moves_with(arm, smooth, Operation.of(heavier, smooth, smooth.logged, smooth.temperature), SCALED)
    assert moved == {name: effect_named(name).follows_model for name in moved}


def test_columns_move_with_the_findings_only_where_the_effect_says_so(arm, smooth):
    moved = moves_with(arm, smooth, smooth.after_fit(1.4 * smooth.expected), ())
    assert [name for name, moves in moved.items() if moves > effect_named(name).follows_torque] == []


def test_every_parameter_has_a_plausible_range_within_the_possible_one_and_a_reason(arm):
    for effect in EFFECTS:
        place = effect.places(arm)[-1]
        for parameter in (*effect.parameters(arm, place), *effect.optional_parameters(arm, place)):
            low, high = parameter.plausible
            assert parameter.lower <= low < high <= parameter.upper, (effect.name, parameter.name)
            assert len(parameter.plausible_because.split()) > 3, (effect.name, parameter.name)


FRICTION = ("viscous_friction", "coulomb_friction", "direction_dependent_friction", "stribeck_friction")


@pytest.mark.parametrize("name", FRICTION)
def test_friction_takes_away_no_more_than_is_modelled(arm, name):
    # By the contract: what is found and what is modelled are together not negative, in the parameters and in the fits.
    rubbing = replace(arm, viscous_friction=np.array([0.0, 0.3, 0.0]), coulomb_friction=np.array([0.0, 0.7, 0.0]))
    effect = effect_named(name)
    least = [p.lower for p in effect.parameters(rubbing, "tilt") if "velocity" not in p.name]
    modelled = [-0.3 if "coefficient" in p.name else -0.7 for p in effect.parameters(rubbing, "tilt")][: len(least)]
    assert least == modelled
    shape = (1.0,) if name == "stribeck_friction" else ()
    bounds = [low for low, _ in effect.coefficient_bounds(rubbing, "tilt", shape)]
    assert bounds == ([-0.7, 0.0] if name == "stribeck_friction" else modelled)


def test_the_special_cases_of_an_effect_are_other_effects_of_the_catalogue(arm, operation):
    names = {effect.name for effect in EFFECTS}
    for effect in EFFECTS:
        place, shape, signature = at_last(effect, arm, operation)
        cases = effect.special_cases(arm, place, np.full(len(signature.names), 0.1), shape)
        assert {name for case in cases for name in case.names} <= names - {effect.name}, effect.name


@pytest.mark.parametrize("name", ["direction_dependent_friction", "stribeck_friction", "presliding_friction"])
def test_a_law_is_the_sum_of_its_special_case_where_its_numbers_are_zero(arm, smooth, name):
    # Oracle: the special case's own columns make the same torque.
    effect = effect_named(name)
    coefficients, shape = {
        "direction_dependent_friction": (np.array([0.4, 0.4, 0.0, 0.0]), ()),
        "stribeck_friction": (np.array([0.4, 0.0]), (0.3,)),
        "presliding_friction": (np.array([0.4]), (0.0,)),
    }[name]
    case = next(c for c in effect.special_cases(arm, "tilt", coefficients, shape) if c.names)
    np.testing.assert_array_equal(case.numbers, 0.0)
    torque = effect.torque(arm, smooth, "tilt", effect.from_coefficients(arm, "tilt", coefficients, shape))
    assert case.names == ("coulomb_friction",)
    simple = np.sign(smooth.v[:, 1]) * 0.4
    moving = np.abs(smooth.v[:, 1]) > 0.02
    moving[0] = False
    np.testing.assert_allclose(torque[moving, 1], -simple[moving], atol=1e-9)


def test_what_pulls_either_way_may_be_there_unseen_with_either_sign(arm):
    # By their laws: a constant torque, a ratio about one, gravity's direction and a zero have no sign of their own.
    either = {e.name for e in EFFECTS if any(one.either_sign for one in e.parameters(arm, e.places(arm)[-1]))}
    assert either == {"torque_offset", "torque_constant", "base_tilt", "encoder_offset"}


def test_only_rounding_leaves_nothing_but_noise():
    assert [effect.name for effect in EFFECTS if effect.only_noise] == ["encoder_quantization"]


# Effects that are tried again about a fit, rather than at the estimate of a secant.
ABOUT = [e for e in EFFECTS if not e.shape_is_estimate and e.name not in {"transmission_compliance"}]


def test_the_next_shapes_lie_about_the_last_by_less_than_a_half(arm, smooth):
    for effect in ABOUT:
        _, shape, signature = at_last(effect, arm, smooth)
        next_shapes = effect.refined(np.full(len(signature.names), 0.1), shape)
        factors = np.array([np.divide(found, shape) for found in next_shapes])
        assert (factors == 1.0).all(axis=1).any(), effect.name
        assert np.abs(factors - 1.0).max(initial=0.0) < 0.5, effect.name
        assert len(set(map(tuple, factors))) == len(factors), effect.name


@pytest.mark.parametrize(
    ("name", "expected"),
    [("backlash", 2e-3), ("stribeck_friction", 2e-3), ("input_delay", 3e-3)],
)
def test_a_law_agrees_with_its_coefficients_at_its_shape_or_at_the_last_estimate(name, expected):
    # A play or a Stribeck velocity is no coefficient: the shape stays. A delay is its coefficient.
    assert effect_named(name).at_estimate(np.array([3e-3]), (2e-3,)) == pytest.approx((expected,))


def test_a_compliance_is_its_coefficient_and_keeps_its_damping():
    spring = effect_named("transmission_compliance")
    assert spring.at_estimate(np.array([3e-3]), (2e-3, 0.1)) == pytest.approx((3e-3, 0.1))


# What sets single effects apart, by their laws: a gain of the whole torque; lists of waves, whose orders the positions
# tell, and a reference temperature; a column that is the first order of a sine of the true angle.
APART = {
    "scales_joint": {"torque_constant"},
    "shape_held": {*LISTS, "temperature_dependent_friction"},
    "first_order": {"encoder_eccentricity"},
    "rubs": {
        "coulomb_friction", "direction_dependent_friction", "stribeck_friction", "presliding_friction",
        "load_dependent_friction", "position_dependent_friction", "temperature_dependent_friction",
    },
}  # fmt: skip


def test_effects_of_waves_and_of_places_take_lists(arm):
    # By their laws: any number of waves, and of places.
    assert {effect.name for effect in EFFECTS if effect.takes_lists(arm, effect.places(arm)[-1])} == LISTS


def test_what_is_true_of_few_effects_is_true_of_those():
    assert {name: {effect.name for effect in EFFECTS if getattr(effect, name)} for name in APART} == APART


# Columns of the load that a play passes end at an edge of their own; limits are compared with a smoothed command.
SMOOTHED = {"backlash", "torque_saturation"}


def test_columns_move_with_accelerations_where_the_effect_says_so(arm, smooth):
    faster = Motion(smooth.t, smooth.q, smooth.v, 1.3 * smooth.a)
    moved = moves_with(arm, smooth, Operation.of(arm, faster, temperature=smooth.temperature), SMOOTHED, UNASKED)
    assert moved == {name: effect_named(name).uses_acceleration for name in moved}


def test_the_next_shapes_are_as_long_as_the_last_and_end_with_the_estimate_where_the_shape_is_one(arm, operation):
    for effect in EFFECTS:
        _, shape, signature = at_last(effect, arm, operation)
        coefficients = np.full(len(signature.names), 0.1)
        *_, last = shapes = effect.refined(coefficients, shape)
        assert {len(next_shape) for next_shape in shapes} == {len(shape)}, effect.name
        estimate = last[: len(coefficients)]  # behind that of a spring is its damping
        assert (len(shape) > 0 and np.array_equal(estimate, coefficients)) is effect.shape_is_estimate, effect.name


def test_numbers_that_are_not_stated_are_none():
    empty = ModelNumbers()
    assert not empty.whole
    assert (empty.viscous, empty.coulomb, empty.rotor_inertia, empty.waves) == (0.0, 0.0, 0.0, ())


def test_no_device_has_a_stiffness_or_a_step_of_zero(arm):
    # By their laws: a stiffness and a step are divided by; every other parameter may be zero.
    every = [(effect.name, one) for effect in EFFECTS for one in effect.parameters(arm, effect.places(arm)[-1])]
    above = {(name, one.name) for name, one in every if one.above_zero}
    assert above == {("transmission_compliance", "stiffness"), ("encoder_quantization", "step")}


SAYING = [effect for effect in EFFECTS if effect.formula(lambda kind: 0.0)]


@pytest.mark.parametrize("effect", SAYING, ids=name_of)
def test_the_terms_that_an_effect_says_are_made_by_its_columns(arm, smooth, effect):
    # Oracle: least squares; a torque constant scales friction too, which a formula counts by itself.
    row, middles = 1, {"q": 0.1, "temp": 35.0}
    signature = effect.signature(arm, smooth, "tilt", first_shape(effect, arm, smooth, "tilt"))
    columns = signature.columns[:, 0]
    load = smooth.transmitted if effect.name == "load_dependent_friction" else smooth.tau
    inputs = {"q": smooth.q, "v": smooth.v, "a": smooth.a, "tl": load, "temp": smooth.temperature}
    for term in effect.formula(middles.__getitem__):
        given = [inputs[name][:, row] for name in inspect.signature(term.column).parameters]
        wanted = np.broadcast_to(term.column(*given), len(smooth.t))
        made = columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
        np.testing.assert_allclose(made, wanted, atol=1e-9 * np.abs(wanted).max())
