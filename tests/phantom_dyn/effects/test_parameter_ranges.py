"""Possible and plausible ranges of the parameters of effects, and the values at which an effect vanishes."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.support.rows import stated_limit
from phantom_dyn.model.robot import Robot

LIMIT = 5.0  # N m, or N


ALL = (-np.inf, np.inf)


POSITIVE = (0.0, np.inf)


DRIVEN = (0.0, LIMIT)


TURN = (-np.pi, np.pi)


# Plausible range of each parameter on a hinge with a drive of 5 N m, without modelled friction.
PLAUSIBLE = {
    "viscous_friction": {"coefficient": POSITIVE},
    "coulomb_friction": {"torque": DRIVEN},
    "direction_dependent_friction": {
        "torque_positive": DRIVEN,
        "torque_negative": DRIVEN,
        "coefficient_positive": POSITIVE,
        "coefficient_negative": POSITIVE,
    },
    "stribeck_friction": {"coulomb_torque": DRIVEN, "static_torque": DRIVEN, "stribeck_velocity": (0.0, 3.0)},
    "presliding_friction": {
        "torque": DRIVEN,
        "displacement": (0.0, 0.2),
        "static_ratio": (1.0, 3.0),
        "stick_velocity": (0.0, 0.1),
    },
    "load_dependent_friction": {"ratio": (0.0, 0.5)},
    "position_dependent_friction": {"position": ALL, "torque": DRIVEN},
    "temperature_dependent_friction": {
        "coulomb_torque": DRIVEN,
        "coefficient": POSITIVE,
        "torque_slope": (-LIMIT / 10, LIMIT / 10),
        "coefficient_slope": ALL,
        "reference_temperature": (-60.0, 200.0),
    },
    "torque_offset": {"torque": (-LIMIT, LIMIT)},
    "torque_constant": {"ratio": (0.5, 2.0)},
    "torque_saturation": {"limit": (0.05 * LIMIT, 1.5 * LIMIT)},
    "input_delay": {"delay": (0.0, 0.1)},
    "actuator_lag": {"time_constant": (0.0, 0.1)},
    # The drive moves its rotor alone by 10 rad/s^2 at least.
    "rotor_inertia": {"inertia": (0.0, LIMIT / 10.0)},
    "cogging": {"order": (0.0, 1e5), "amplitude": DRIVEN, "phase": TURN},
    "torque_ripple": {"order": (0.0, 1e5), "amplitude": (0.0, 0.5), "phase": TURN},
    # The arm carries a part of 0.4 kg on a fixed joint; a quarter more may be missing.
    "payload": {"mass": (-0.5, 1000.0), **dict.fromkeys(("center_x", "center_y", "center_z"), (-3.0, 3.0))},
    "base_tilt": dict.fromkeys(("roll", "pitch", "yaw"), (-0.35, 0.35)),
    "parasitic_spring": {"stiffness": POSITIVE, "rest_position": ALL},
    "backlash": {"gap": (0.0, 0.1)},
    "encoder_offset": {"offset": (-0.5, 0.5)},
    "encoder_eccentricity": {"amplitude": (0.0, 0.1), "phase": TURN, "order": (1.0, 100.0)},
    "encoder_quantization": {"step": (0.0, 0.1)},
}


# What is different on a slide.
ON_A_SLIDE = {
    "stribeck_friction": {"stribeck_velocity": (0.0, 0.5)},
    "presliding_friction": {"displacement": (0.0, 0.01)},
    "backlash": {"gap": (0.0, 0.005)},
    "encoder_offset": {"offset": (-0.1, 0.1)},
}


@pytest.fixture
def driven(arm) -> Robot:
    """The arm without modelled friction, with drives of 5 N m or N."""
    actuators = tuple(replace(one, torque_limit=LIMIT) for one in arm.actuators)
    return replace(arm, actuators=actuators, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))


def plausible(robot: Robot, name: str, joint: str) -> dict[str, tuple[float, float] | None]:
    effect = effect_named(name)
    place = joint if effect.scope != "robot" else None
    return {p.name: p.plausible for p in (*effect.parameters(robot, place), *effect.optional_parameters(robot, place))}


def test_a_parameter_is_plausible_in_the_range_of_its_reason(driven):
    assert {name: plausible(driven, name, "tilt") for name in PLAUSIBLE} == PLAUSIBLE
    on_a_slide = {name: PLAUSIBLE[name] | own for name, own in ON_A_SLIDE.items()}
    assert {name: plausible(driven, name, "slide") for name in ON_A_SLIDE} == on_a_slide


def test_without_a_stated_limit_a_drive_may_give_any_torque(arm, driven):
    assert stated_limit(arm, "tilt") == np.inf
    assert stated_limit(driven, "tilt") == LIMIT
    assert stated_limit(driven, "knee") == np.inf
    assert plausible(arm, "torque_saturation", "tilt") == {"limit": POSITIVE}


def test_a_transmission_swings_once_a_second_at_least(planar):
    # Closed form: k = (m l^2 + I) (2 pi)^2 of the elbow's link.
    link = float(planar.model.inertias[2].inertia[1, 1]) + 1.5 * 0.2**2
    (stiffness,) = effect_named("transmission_compliance").parameters(planar, "elbow")
    assert stiffness.plausible == pytest.approx((link * (2 * np.pi) ** 2, np.inf))


def test_a_rotor_takes_away_no_more_than_is_modelled(planar):
    (inertia,) = effect_named("rotor_inertia").parameters(planar, "elbow")
    assert inertia.lower == -planar.rotor_inertia[1]
    assert inertia.plausible == (-planar.rotor_inertia[1], np.inf)


def test_a_drive_measures_its_own_torque_within_a_factor_of_ten(arm):
    # Closed form: the excess of the logged torque is 1 / ratio - 1.
    effect = effect_named("torque_constant")
    (ratio,) = effect.parameters(arm, "tilt")
    assert (ratio.lower, ratio.upper) == (0.1, 10.0)
    assert effect.coefficient_bounds(arm, "tilt", ()) == (pytest.approx((0.1 - 1.0, 10.0 - 1.0)),)
    for excess, stated in ((-2.0, 10.0), (-0.9, 10.0), (1.0, 0.5), (50.0, 0.1)):
        assert effect.from_coefficients(arm, "tilt", np.array([excess]), ()) == pytest.approx([stated])


@pytest.mark.parametrize(
    ("name", "coefficient", "numbers"),
    # By hand: zero where it is nothing, and where it is at the end of what is possible.
    [
        ("input_delay", 0.3, [0.3, -0.7]),
        ("actuator_lag", 0.3, [0.3, -0.7]),
        ("load_dependent_friction", 0.3, [0.3, -0.7]),
        ("torque_constant", 0.3, [0.3, 1.2, -8.7]),
        ("torque_offset", 0.3, [0.3]),
    ],
)
def test_an_effect_at_the_end_of_its_range_is_none(arm, name, coefficient, numbers):
    cases = effect_named(name).special_cases(arm, "tilt", np.array([coefficient]), (0.1,))
    assert [case.names for case in cases] == [()] * len(numbers)
    assert [case.numbers.item() for case in cases] == pytest.approx(numbers)


def test_a_play_is_none_where_no_share_of_it_is_there(arm):
    # How wide it is depends on a law that is known to a half; that it is there does not.
    (case,) = effect_named("backlash").special_cases(arm, "tilt", np.array([0.9]), (0.02,))
    np.testing.assert_array_equal(case.numbers, [0.9])


def test_a_limit_is_no_other_law_whatever_its_size(arm):
    # A limit of zero is no drive at all; one that the command never reaches has no torque, and is not fitted.
    assert effect_named("torque_saturation").special_cases(arm, "tilt", np.array([0.9]), (0.02,)) == ()


def test_a_spring_without_stiffness_is_a_torque_offset(arm):
    nothing, offset = effect_named("parasitic_spring").special_cases(arm, "tilt", np.array([0.4, -0.7]), ())
    assert (nothing.names, offset.names) == ((), ("torque_offset",))
    np.testing.assert_array_equal(nothing.numbers, [0.4, -0.7])
    np.testing.assert_array_equal(offset.numbers, [0.4])


def test_special_cases_of_friction_are_differences_of_its_numbers(arm):
    # By hand: levels of 0.5 and 0.3, slopes of 0.2 and 0.05; an excess of 0.7; a displacement of 0.02.
    dry, viscous, plain = effect_named("direction_dependent_friction").special_cases(
        arm, "tilt", np.array([0.5, 0.3, 0.2, 0.05]), ()
    )
    np.testing.assert_allclose(dry.numbers, [0.2, 0.2, 0.05])
    np.testing.assert_allclose(viscous.numbers, [0.5, 0.3, 0.15])
    np.testing.assert_allclose(plain.numbers, [0.2, 0.15])
    assert plain.names == (*dry.names, *viscous.names)
    stribeck = effect_named("stribeck_friction").special_cases(arm, "tilt", np.array([0.4, 0.7]), (0.1,))
    np.testing.assert_allclose(stribeck[-1].numbers, [0.7])
    warm = effect_named("temperature_dependent_friction").special_cases(
        arm, "tilt", np.array([0.4, 0.3, -0.02, -0.01]), (40.0,)
    )
    assert [case.numbers.tolist() for case in warm] == [[0.3, -0.02, -0.01], [0.4, -0.02, -0.01], [-0.02, -0.01]]
    assert warm[2].names == ("coulomb_friction", "viscous_friction")
    # The time after a reversal for a displacement of 0.04 is proportional to 0.2.
    nothing, coulomb = effect_named("presliding_friction").special_cases(arm, "tilt", np.array([0.4, -0.3]), (0.04,))
    np.testing.assert_allclose([*nothing.numbers, *coulomb.numbers], [0.1, 0.08, 0.08])


def test_wheels_of_a_coupling_differ_by_less_than_a_factor_of_ten(driven):
    found = plausible(driven, "joint_coupling", "turn+tilt")
    assert found == {"ratio": (-10.0, 10.0), "coulomb_torque": DRIVEN, "coefficient": POSITIVE, "inertia": POSITIVE}


# Possible ranges that are not from zero on: either way, as far as a joint turns round, or as the law says.
POSSIBLE = {
    ("torque_offset", "torque"): ALL,
    ("torque_constant", "ratio"): (0.1, 10.0),
    ("payload", "center_x"): ALL,
    ("payload", "center_y"): ALL,
    ("payload", "center_z"): ALL,
    ("parasitic_spring", "rest_position"): ALL,
    ("presliding_friction", "static_ratio"): (1.0, np.inf),
    ("load_dependent_friction", "ratio"): (0.0, 1.0),
    ("position_dependent_friction", "position"): ALL,
    ("temperature_dependent_friction", "torque_slope"): ALL,
    ("temperature_dependent_friction", "coefficient_slope"): ALL,
    ("temperature_dependent_friction", "reference_temperature"): (-60.0, 200.0),
    ("joint_coupling", "ratio"): ALL,
    ("cogging", "phase"): TURN,
    ("torque_ripple", "phase"): TURN,
    ("base_tilt", "roll"): (-0.5 * np.pi, 0.5 * np.pi),
    ("base_tilt", "pitch"): (-0.5 * np.pi, 0.5 * np.pi),
    ("base_tilt", "yaw"): (-0.5 * np.pi, 0.5 * np.pi),
    ("encoder_offset", "offset"): TURN,
    ("encoder_eccentricity", "phase"): ALL,
}


def test_a_parameter_is_possible_from_zero_on_unless_its_law_makes_sense_elsewhere(driven):
    ranges = {}
    for effect in (effect for effect in EFFECTS if effect.name != "inertial_parameters"):
        place = "tilt" if "tilt" in effect.places(driven) else effect.places(driven)[0]
        for one in (*effect.parameters(driven, place), *effect.optional_parameters(driven, place)):
            if one.name != "mass":  # the link that carries it says how much can be missing
                ranges[effect.name, one.name] = (one.lower, one.upper)
    assert ranges == {place: POSSIBLE.get(place, POSITIVE) for place in ranges}


def test_fits_take_away_no_more_of_a_rotor_than_is_modelled(planar):
    bounds = effect_named("rotor_inertia").coefficient_bounds(planar, "elbow", ())
    assert bounds == ((-planar.rotor_inertia[1], np.inf),)


@pytest.mark.parametrize(
    ("name", "factors"),
    [
        ("stribeck_friction", [0.85, 1.0, 1.18]),
        ("presliding_friction", [0.75, 1.0, 4 / 3]),
        ("backlash", [0.8, 0.93, 1.0, 1.07, 1.25]),
    ],
)
def test_shapes_that_are_tried_next_lie_about_as_far_below_as_above(name, factors):
    # In ratios: a sixth for a velocity, a third for a displacement, a quarter for a gap.
    shapes = effect_named(name).refined(np.array([0.4, 0.7]), (0.02,))
    assert [size for (size,) in shapes] == pytest.approx(0.02 * np.array(factors))
    assert factors[0] * factors[-1] == pytest.approx(1.0, abs=0.01)
