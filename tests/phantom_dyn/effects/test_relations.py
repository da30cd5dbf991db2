"""Relations between effects, ranges of their parameters and operations on logs."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.dynamics.dynamics import link_torque
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.relations import RELATIONS, related
from phantom_dyn.effects.support.rows import stated_limit
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

JOINT = "tilt"

# Largest part of a column that may be left where another effect makes it.
LEFT = 0.01

# Shapes at which an effect comes to a simpler one: no displacement of a bristle; five places over the travel.
AT = {"presliding_friction": (1e-9,), "position_dependent_friction": (-0.7, 0.7, 5.0)}

ON_ONE_JOINT = [effect for effect in EFFECTS if effect.scope == "joint" and effect.inertial is None]


def columns(effect: Effect, arm: Robot, motion: Operation, at: dict[str, tuple[float, ...]]) -> np.ndarray:
    """Columns on the joint itself while it moves; where nothing asks for an effect of lists, none."""
    shapes = (at[effect.name],) if effect.name in at else effect.shapes(arm, motion, JOINT)
    if not shapes:
        return np.zeros((len(motion.t), 0))
    signature = effect.signature(arm, motion, JOINT, shapes[0])
    # At the first sample and where it turns about, a bristle of no displacement is late by a sample.
    moving = np.abs(motion.v[:, 1]) > 0.05
    moving[0] = False
    return signature.columns[moving, signature.rows.index(1)]


def left_of(column: np.ndarray, by: np.ndarray) -> float:
    """Share of a column's length that is outside the span of others."""
    inside = by @ np.linalg.lstsq(by, column, rcond=None)[0]
    return float(np.linalg.norm(column - inside) / np.linalg.norm(column))


def made_by(rich: Effect, simple: Effect, arm: Robot, motion: Operation) -> bool:
    """True if the columns of one effect make all those of another."""
    own, other = columns(rich, arm, motion, AT), columns(simple, arm, motion, {})
    other = other[:, np.abs(other).max(axis=0) > 0]
    if not own.size or not other.size:
        return False
    return all(left_of(column, own) < LEFT for column in other.T)


def test_rows_are_of_two_effects_of_the_catalogue_each_once():
    known = {effect.name for effect in EFFECTS}
    assert all(row.effect != row.other for row in RELATIONS)
    assert {name for row in RELATIONS for name in (row.effect, row.other)} <= known
    assert len(set(RELATIONS)) == len(RELATIONS)


@pytest.mark.parametrize("rich", ON_ONE_JOINT, ids=lambda effect: effect.name)
def test_what_the_columns_of_an_effect_make_is_in_the_table(arm, wide, rich):
    warm = replace(wide, temperature=30.0 + np.outer(wide.t**1.5, np.ones(3)) / 9.0)
    made = {one.name for one in ON_ONE_JOINT if one is not rich and made_by(rich, one, arm, warm)}
    assert made == {*related(rich.name, "contains"), *related(rich.name, "tends to")}


@pytest.mark.parametrize(
    "row", [row for row in RELATIONS if row.kind == "contains" and row.other == "payload"], ids=lambda row: row.effect
)
def test_a_load_is_a_change_of_the_link_that_carries_it(arm, row):
    rich, load = effect_named(row.effect), effect_named(row.other)
    last = arm.joint_names[-1]
    assert set(load.regressor_columns(arm, None)) <= set(rich.regressor_columns(arm, last))


def test_a_coupling_resembles_what_its_columns_are_where_the_second_joint_is_still(arm, smooth):
    # Closed form: with v_j = 0 the coupled speed is that of the first joint.
    still = np.array([1.0, 0.0, 1.0])
    held = Operation.of(arm, Motion(smooth.t, smooth.q, smooth.v * still, smooth.a * still))
    coupling = effect_named("joint_coupling")
    own = coupling.signature(arm, held, "turn+tilt", (1.0,)).columns[:, 0]
    for name in coupling.on_each_joint:
        (column,) = effect_named(name).signature(arm, held, "turn", ()).columns[:, 0].T
        assert left_of(column, own) < LEFT


def test_an_effect_that_may_be_a_sum_makes_the_columns_of_all_its_parts(arm, smooth):
    for rich in {row.effect for row in RELATIONS if row.kind == "may be a sum with"}:
        parts = [effect_named(name) for name in effect_named(rich).same_as_sum]
        assert len(parts) > 1
        assert all(made_by(effect_named(rich), part, arm, smooth) for part in parts)


@pytest.fixture
def moving(planar, rng) -> Operation:
    """Fifty states of two links with rotors and friction, at 20 Hz from half a second on."""
    return Operation.of(planar, Motion(0.5 + np.arange(50) / 20.0, *rng.uniform(-1, 1, (3, 50, 2))))


def test_the_time_step_is_the_mean_one(planar, moving):
    assert moving.dt == pytest.approx(0.05)
    one = Operation.of(planar, Motion(*(x[:1] for x in (moving.t, moving.q, moving.v, moving.a))))
    assert one.dt == 0.0


def test_transmissions_pass_what_links_and_friction_take(planar, moving):
    np.testing.assert_allclose(moving.transmitted, link_torque(planar, moving) + moving.own_friction, atol=1e-12)
    v = moving.v
    friction = planar.viscous_friction * v + planar.coulomb_friction * np.sign(v)
    np.testing.assert_allclose(moving.own_friction, friction, atol=1e-12)


def test_the_residual_is_that_of_the_model_until_a_fit_leaves_another(planar, moving):
    recorded = Operation.of(planar, moving, moving.tau + 3.0)
    np.testing.assert_allclose(recorded.residual, 3.0)
    np.testing.assert_array_equal(recorded.again(recorded.tau, 0.1 * recorded.q).residual, 0.1 * recorded.q)


def test_another_fit_keeps_what_is_known_of_the_motion(moving):
    known = moving.transmitted, moving.inertia, moving.own_friction
    again = moving.again(2.0 * moving.expected)
    assert all(
        one is other for one, other in zip((again.transmitted, again.inertia, again.own_friction), known, strict=True)
    )
    np.testing.assert_array_equal(again.expected, 2.0 * moving.expected)


def test_what_is_known_of_parts_is_that_of_the_whole(planar, moving):
    first, second = (
        Operation.of(planar, Motion(*(x[k] for x in (moving.t, moving.q, moving.v, moving.a))))
        for k in (slice(0, 1), slice(1, None))
    )
    whole = Operation.of(planar, moving).made_of((first, second))
    for name in ("own_friction", "transmitted", "inertia", "steepest"):
        np.testing.assert_allclose(whole.__dict__[name], getattr(moving, name), atol=1e-12)


def test_parts_of_another_robot_tell_nothing(planar, moving):
    other = replace(planar, coulomb_friction=2.0 * planar.coulomb_friction)
    assert not moving.made_of((Operation.of(other, moving),)).__dict__.keys() & {"own_friction", "inertia"}


def test_partials_are_those_of_pinocchio(planar, moving):
    data = planar.model.createData()
    pin.computeRNEADerivatives(planar.model, data, moving.q[3], moving.v[3], moving.a[3])
    to_q, to_v, mass = (part[3] for part in moving.partials)
    np.testing.assert_allclose(to_q, data.dtau_dq, atol=1e-12)
    np.testing.assert_allclose(to_v, data.dtau_dv, atol=1e-12)
    np.testing.assert_allclose(mass, pin.crba(planar.model, planar.model.createData(), moving.q[3]), atol=1e-12)


def test_the_time_step_of_two_samples_is_what_lies_between_them(planar, moving):
    two = Operation.of(planar, Motion(*(x[:2] for x in (moving.t, moving.q, moving.v, moving.a))))
    assert two.dt == pytest.approx(0.05)


def test_what_effects_keep_in_a_copy_for_a_while_is_not_kept_in_the_operation(moving):
    moving.kept["before", 0] = moving.tau
    short = moving.for_a_while()
    short.kept["after", 0] = moving.tau
    assert short.kept["before", 0] is moving.kept["before", 0]
    assert ("after", 0) not in moving.kept


def test_the_rate_of_the_expected_torque_is_that_of_the_last_fit(moving):
    # Oracle: a torque that rises evenly.
    rising = moving.again(np.outer(moving.t, np.arange(1.0, moving.tau.shape[1] + 1)))
    assert moving.expected_rate is not rising.expected_rate
    np.testing.assert_allclose(rising.expected_rate, np.arange(1.0, moving.tau.shape[1] + 1) * np.ones_like(moving.tau))


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


@pytest.mark.parametrize("name", PLAUSIBLE)
def test_a_parameter_on_a_hinge_is_plausible_in_the_range_of_its_reason(driven, name):
    assert plausible(driven, name, "tilt") == PLAUSIBLE[name]


@pytest.mark.parametrize("name", ON_A_SLIDE)
def test_a_parameter_on_a_slide_is_plausible_in_the_range_of_its_reason(driven, name):
    assert plausible(driven, name, "slide") == {**PLAUSIBLE[name], **ON_A_SLIDE[name]}


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


def test_a_limit_is_none_where_it_is_zero(arm):
    (case,) = effect_named("torque_saturation").special_cases(arm, "tilt", np.array([0.9]), (0.02,))
    np.testing.assert_array_equal(case.numbers, [0.02])


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
    nothing, coulomb = effect_named("presliding_friction").special_cases(arm, "tilt", np.array([0.4]), (0.02,))
    np.testing.assert_allclose([nothing.numbers.item(), coulomb.numbers.item()], [0.4, 0.02])


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


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.name != "inertial_parameters"], ids=lambda e: e.name)
def test_a_parameter_is_possible_from_zero_on_unless_its_law_makes_sense_elsewhere(driven, effect):
    places = effect.places(driven)
    place = "tilt" if "tilt" in places else places[0]
    for parameter in (*effect.parameters(driven, place), *effect.optional_parameters(driven, place)):
        if parameter.name != "mass":  # the link that carries it says how much can be missing
            expected = POSSIBLE.get((effect.name, parameter.name), POSITIVE)
            assert (parameter.lower, parameter.upper) == expected


def test_fits_take_away_no_more_of_a_rotor_than_is_modelled(planar):
    bounds = effect_named("rotor_inertia").coefficient_bounds(planar, "elbow", ())
    assert bounds == ((-planar.rotor_inertia[1], np.inf),)


@pytest.mark.parametrize(
    ("name", "factors"),
    [
        ("stribeck_friction", [0.85, 1.0, 1.18]),
        ("presliding_friction", [0.75, 1.0, 4 / 3]),
        ("backlash", [0.8, 1.0, 1.25]),
    ],
)
def test_shapes_that_are_tried_next_lie_about_as_far_below_as_above(name, factors):
    # In ratios: a sixth for a velocity, a third for a displacement, a quarter for a gap.
    shapes = effect_named(name).refined(np.array([0.4, 0.7]), (0.02,))
    assert [size for (size,) in shapes] == pytest.approx(0.02 * np.array(factors))
    assert factors[0] * factors[2] == pytest.approx(1.0, abs=0.01)
