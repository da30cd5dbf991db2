"""How effects enter a simulation: numbers of the model, compiled laws, what they say of themselves."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.compiled_laws import (
    COMMANDS,
    READINGS,
    TORQUES,
    command_of,
    number_of,
    reading_of,
    torque_call,
    torque_of,
)
from phantom_dyn.effects.described import Coupling, ModelNumbers
from phantom_dyn.effects.drive.input_delay import delay_law
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.friction.presliding_friction import stick_law
from phantom_dyn.effects.rival import Rival
from phantom_dyn.effects.simulated import Law, Simulated

TORQUE_LAWS = {
    "direction_dependent_friction": ("tilt", (0.5, 0.3, 0.2, 0.1)),
    "stribeck_friction": ("tilt", (0.3, 0.8, 0.4)),
    "torque_offset": ("tilt", (-0.7,)),
    "parasitic_spring": ("tilt", (4.0, 0.25)),
    "presliding_friction": ("tilt", (0.6, 0.3)),
    "load_dependent_friction": ("tilt", (0.15,)),
    "position_dependent_friction": ("tilt", (0.2, 0.4)),
    "joint_coupling": ("turn+slide", (-0.7, 0.3, 0.2, 0.0)),
    "cogging": ("tilt", (6.0, 0.03, 0.7)),
    "torque_ripple": ("tilt", (6.0, 0.03, 0.7)),
}

READING_LAWS = {"encoder_offset": (0.3,), "encoder_eccentricity": (0.05, 0.7, 2.0), "encoder_quantization": (0.1,)}


def padded(values: tuple[float, ...], size: int) -> tuple[float, ...]:
    return (*values, *(0.0,) * (size - len(values)))


def along(law: Law, operation) -> np.ndarray:
    """Torque of one law on all joints, sample after sample."""
    code, state, out = number_of(law.function), padded(law.start, 3), np.zeros_like(operation.tau)
    speed = operation.v[:, law.row] + law.share * operation.v[:, law.other]
    for k in range(len(operation.t)):
        here = operation.q[k, law.row], speed[k], operation.transmitted[k, law.row]
        *state, torque = torque_of(code, *padded(law.numbers, 4), *state, *here)
        out[k, law.row] += torque
        out[k, law.other] += law.share * torque
    return out


@pytest.mark.parametrize("name", TORQUE_LAWS)
def test_a_torque_law_on_scalars_gives_what_the_effect_gives_in_python(arm, smooth, torque_in_steps, name):
    joint, theta = TORQUE_LAWS[name]
    simulated = effect_named(name).simulated(arm, joint, np.array(theta))
    (law,) = simulated.laws
    np.testing.assert_allclose(along(law, smooth), torque_in_steps(simulated, smooth), atol=1e-12)


def test_friction_that_sticks_gives_on_scalars_what_it_gives_in_python(arm, smooth, torque_in_steps):
    simulated = effect_named("presliding_friction").simulated(arm, "tilt", np.array([0.6, 0.01, 1.4, 0.3]))
    stepped = torque_in_steps(simulated, smooth)
    np.testing.assert_allclose(along(simulated.laws[0], smooth), stepped, atol=1e-12)
    assert np.abs(stepped).max() > 0.6  # it sticks somewhere


@pytest.mark.parametrize(
    ("name", "theta"), [("torque_constant", 0.7), ("torque_saturation", 0.9), ("actuator_lag", 0.02)]
)
def test_a_drive_on_scalars_gives_what_it_gives_in_python(arm, given_in_steps, rng, name, theta):
    t, asked = 0.01 * np.arange(60), 2.0 * rng.normal(size=(60, 3))
    simulated = effect_named(name).simulated(arm, "tilt", np.array([theta]))
    (law,) = simulated.laws
    state, given = padded(law.start, 1)[0], []
    for tau in asked[:, 1]:
        state, out = command_of(number_of(law.function), law.numbers[0], state, 0.01, tau)
        given.append(out)
    np.testing.assert_allclose(given, given_in_steps(simulated, t, asked)[:, 1], atol=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.013, 0.03])
def test_a_line_of_commands_on_scalars_gives_what_the_drive_gives_in_python(arm, given_in_steps, rng, delay):
    # The ring goes round many times: it holds the steps of a delay and two, here five of sixty.
    t, asked = 0.01 * np.arange(60), rng.normal(size=(60, 3))
    line, first, last, given = np.zeros((6, 2)), 0, -1, []
    for tau in asked[:, 1]:
        first, last, out = delay_law(line, first, last, delay, 0.01, tau)
        given.append(out)
    simulated = effect_named("input_delay").simulated(arm, "tilt", np.array([delay]))
    np.testing.assert_allclose(given, given_in_steps(simulated, t, asked)[:, 1], atol=1e-12)


@pytest.mark.parametrize("name", READING_LAWS)
def test_a_reading_on_scalars_is_that_of_the_effect_in_python(arm, smooth, name):
    simulated = effect_named(name).simulated(arm, "tilt", np.array(READING_LAWS[name]))
    (law,) = simulated.laws
    code, numbers = number_of(law.function), padded(law.numbers, 3)
    assert simulated.reading is not None
    read = np.array([simulated.reading(q)[1] for q in smooth.q[::20]])
    np.testing.assert_allclose([reading_of(code, *numbers, q) for q in smooth.q[::20, 1]], read, atol=1e-12)
    assert np.abs(read - smooth.q[::20, 1]).max() > 0.01


def test_the_laws_are_those_that_the_effects_put_into_a_simulation(arm):
    # Oracle: what each effect says of itself when it is simulated.
    used = {law.function for name in TORQUE_LAWS for law in _laws(arm, name, *TORQUE_LAWS[name])}
    assert used | {stick_law} == set(TORQUES)
    assert {law.function for name in READING_LAWS for law in _laws(arm, name, "tilt", READING_LAWS[name])} == {
        *READINGS
    }
    numbers = [number_of(law) for law in (*TORQUES, *COMMANDS, *READINGS)]
    assert len(set(numbers)) == len(numbers) == 18


def _laws(arm, name: str, joint: str, theta: tuple[float, ...]) -> tuple[Law, ...]:
    return effect_named(name).simulated(arm, joint, np.array(theta)).laws


def test_a_law_that_is_not_known_gives_no_number():
    assert np.isnan(torque_of(1, *(0.1,) * 10)[3])
    assert np.isnan(command_of(1, *(0.1,) * 4)[1])
    assert np.isnan(reading_of(1, *(0.1,) * 4))


def test_arguments_of_a_law_are_in_their_order():
    assert torque_call("f", ["last", "z", "q", "torque", "way"]) == (
        "s1, torque = f(s0, s1, q, p0, p1); return q, s1, s2, torque"
    )
    assert torque_call("f", ["level"]) == "return s0, s1, s2, f(p0)"
    for names in (["level", "v"], ["v", "level", "q"], ["z", "last", "q"], ["q", *"abcde"], ["last", *"abc", "q"]):
        with pytest.raises(TypeError, match=r"A torque law takes .*: give it last .* then at most four parameters"):
            torque_call("f", names)


def test_a_drive_without_a_law_for_series_is_stepped_through():
    # Known truth: a drive that gives what was asked of it the sample before.
    late = Simulated(start=np.zeros(2), command=lambda state, dt, tau: (tau, state))
    asked = np.arange(10.0).reshape(5, 2)
    given = late.given(0.01 * np.arange(5), asked)
    np.testing.assert_array_equal(given, np.vstack([np.zeros(2), asked[:-1]]))


def test_what_is_no_drive_leaves_the_torque_alone():
    asked = np.arange(10.0).reshape(5, 2)
    np.testing.assert_array_equal(Simulated().given(0.01 * np.arange(5), asked), asked)


@pytest.mark.parametrize(
    ("name", "theta"),
    [("torque_constant", 0.7), ("torque_saturation", 0.4), ("input_delay", 0.02), ("actuator_lag", 0.03)],
)
def test_a_series_is_what_the_steps_come_to(arm, name, theta):
    # Steps hold each command for a sample of 0.1 ms, a series joins them by straight lines: half a sample apart.
    t = 1e-4 * np.arange(5000)
    asked = np.sin(np.outer(t, [4.0, 7.0, 9.0]))
    drive = effect_named(name).simulated(arm, "tilt", np.array([theta]))
    assert drive.series is not None
    stepped = replace(drive, series=None).given(t, asked)
    np.testing.assert_allclose(drive.given(t, asked), stepped, atol=1e-3)


def test_the_last_step_of_a_drive_is_as_long_as_the_one_before():
    seen = []

    def command(state, dt, tau):
        seen.append(dt)
        return state, tau

    Simulated(command=command).given(np.array([0.0, 0.1, 0.4, 0.45]), np.zeros((4, 1)))
    np.testing.assert_allclose(seen, [0.1, 0.3, 0.05, 0.05])


# Effects that move another robot, add a torque, or both.
MOVED = {
    "viscous_friction": ("tilt", (0.4,)),
    "coulomb_friction": ("slide", (0.4,)),
    "direction_dependent_friction": ("tilt", (0.5, 0.3, 0.11, 0.23)),
    "stribeck_friction": ("tilt", (0.4, 0.9, 0.2)),
    "temperature_dependent_friction": ("tilt", (0.4, 0.2, 0.0, 0.0, 25.0)),
    "load_dependent_friction": ("tilt", (0.15,)),
    "position_dependent_friction": ("tilt", (-0.6, 0.1, 0.5, 0.2, 0.7, 0.3)),
    "torque_offset": ("tilt", (-0.7,)),
    "rotor_inertia": ("slide", (0.3,)),
    "payload": (None, (0.8, 0.1, -0.05, 0.2)),
    "inertial_parameters": ("tilt", (0.1, 0.02, 0.0, -0.03, 0.02, 0.001, 0.02, 0.0, 0.002, 0.02)),
    "base_tilt": (None, (0.2, -0.3, 0.0)),
    "parasitic_spring": ("tilt", (4.0, 0.25)),
    "cogging": ("tilt", (6.0, 0.03, 0.7)),
    "torque_ripple": ("tilt", (6.0, 11.0, 0.03, 0.1, 0.7, -0.3)),
}


@pytest.mark.parametrize("name", MOVED)
def test_what_moves_in_a_simulation_lacks_the_torque_of_the_law(arm, operation, torque_in_steps, name):
    # Inverse dynamics: the drives of the other robot need more by minus the torque of the law, less what is added.
    joint, theta = MOVED[name]
    effect = effect_named(name)
    simulated = effect.simulated(arm, joint, np.array(theta))
    moved = arm if simulated.robot is None else simulated.robot(arm)
    found = inverse_dynamics(arm, operation) - inverse_dynamics(moved, operation)
    if simulated.torque is not None:
        found = found + torque_in_steps(simulated, operation)
    moving = operation.v.all(axis=1)
    expected = effect.torque(arm, operation, joint, np.array(theta))
    np.testing.assert_allclose(found[moving], expected[moving], atol=1e-9)


PROBED = {
    "viscous_friction": "N m s/rad",
    "stribeck_friction": "N m",
    "direction_dependent_friction": "N m s/rad",
    "parasitic_spring": "N m/rad",
    "cogging": "N m",
    "torque_constant": "1",
    "backlash": "rad",
    "presliding_friction": "N m",
}


@pytest.mark.parametrize("name", PROBED)
def test_what_is_probed_has_the_unit_of_its_parameter(arm, operation, name):
    effect = effect_named(name)
    probed = "amplitude" if name == "cogging" else effect.probe(arm, operation, "tilt")[0]
    assert effect.probe_unit(arm, "tilt", probed) == PROBED[name]


OPTIONAL = [name for base in (Rival, Effect) for name in base.__annotations__ if hasattr(base, name)]


def test_an_effect_may_say_ten_things_of_itself_at_most():
    # Whatever is true of one effect alone is better a method of its own, or a row of the table of relations.
    assert 0 < len(OPTIONAL) <= 10


@pytest.mark.parametrize("attribute", OPTIONAL)
def test_what_an_effect_may_say_is_said_by_several(attribute):
    assert sum(attribute in vars(type(effect)) for effect in EFFECTS) > 1


NUMBERS = {
    "viscous_friction": ("tilt", (0.4,), ModelNumbers(whole=True, viscous=0.4)),
    "coulomb_friction": ("tilt", (0.4,), ModelNumbers(whole=True, coulomb=0.4)),
    "direction_dependent_friction": (
        "tilt",
        (0.5, 0.25, 0.125, 0.375),
        ModelNumbers(viscous=0.25, coulomb=0.375, offset=-0.125),
    ),
    "stribeck_friction": ("tilt", (0.5, 0.9, 0.1), ModelNumbers(coulomb=0.5)),
    "presliding_friction": ("tilt", (0.5, 0.9), ModelNumbers(coulomb=0.5)),
    "load_dependent_friction": ("tilt", (0.5,), ModelNumbers()),
    "position_dependent_friction": ("tilt", (-0.5, 0.5, 0.9, 0.25, 0.75, 0.5), ModelNumbers(coulomb=0.5)),
    "temperature_dependent_friction": (
        "tilt",
        (0.5, 0.25, -0.02, -0.01, 40.0),
        ModelNumbers(coulomb=0.5, viscous=0.25),
    ),
    "joint_coupling": (
        "turn+slide",
        (0.5, 0.3, 0.2, 0.1),
        ModelNumbers(whole=True, coupling=Coupling("turn", "slide", 0.5, 0.3, 0.2, 0.1)),
    ),
    "cogging": (
        "tilt",
        (6.0, 12.0, 0.3, 0.2, 0.7, -0.7),
        ModelNumbers(whole=True, waves=((6.0, 0.3, 0.7), (12.0, 0.2, -0.7))),
    ),
    "torque_ripple": ("tilt", (6.0, 0.3, 0.7), ModelNumbers()),
    "torque_offset": ("tilt", (-0.4,), ModelNumbers(whole=True, offset=-0.4)),
    "torque_constant": ("tilt", (0.9,), ModelNumbers(whole=True, gain=0.9)),
    "torque_saturation": ("tilt", (3.0,), ModelNumbers(whole=True, limit=3.0)),
    "input_delay": (None, (0.004,), ModelNumbers(whole=True, delay=0.004)),
    "reference_delay": (None, (0.03,), ModelNumbers(whole=True, reference_delay=0.03)),
    "actuator_lag": (None, (0.02,), ModelNumbers(whole=True, lag=0.02)),
    "rotor_inertia": ("tilt", (0.02,), ModelNumbers(whole=True, rotor_inertia=0.02)),
    "parasitic_spring": ("tilt", (4.0, 0.25), ModelNumbers(whole=True, spring=(4.0, 0.25))),
    "backlash": ("tilt", (0.01,), ModelNumbers(whole=True, gap=0.01)),
    "transmission_compliance": ("tilt", (500.0,), ModelNumbers(whole=True, stiffness=500.0)),
    "encoder_offset": ("tilt", (0.05,), ModelNumbers(whole=True, zero=0.05)),
    "encoder_eccentricity": ("tilt", (0.02, 0.7, 1.0), ModelNumbers()),
    "encoder_quantization": ("tilt", (0.01,), ModelNumbers()),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_model_holds_the_numbers_of_the_law(arm, name):
    joint, theta, expected = NUMBERS[name]
    assert effect_named(name).model_numbers(arm, joint, np.array(theta)) == expected


def test_a_mass_is_held_whole_by_a_heavier_link(arm):
    found = effect_named("payload").model_numbers(arm, None, np.array([0.5, 0.0, 0.1, 0.2]))
    assert found.whole
    assert found.robot is not None
    assert found.robot(arm).model.inertias[3].mass == pytest.approx(arm.model.inertias[3].mass + 0.5)


def test_a_tilt_is_held_by_the_rotation_that_gravity_takes(arm):
    found = effect_named("base_tilt").model_numbers(arm, None, np.array([0.2, -0.3, 0.0]))
    assert found.robot is not None
    assert found.turned is not None
    gravity = found.robot(arm).model.gravity.linear
    np.testing.assert_allclose(found.turned @ arm.model.gravity.linear, gravity, atol=1e-12)


SIZED = {
    ("coulomb_friction", "tilt", "torque"): (0.3,),
    ("coulomb_friction", "tilt", "mass"): None,
    ("stribeck_friction", "tilt", "static_torque"): None,
    ("torque_constant", "tilt", "ratio"): (1 / 1.3,),
    ("parasitic_spring", "tilt", "stiffness"): (0.3, 0.2),
    ("transmission_compliance", "tilt", "compliance"): (1 / 0.3,),
    ("base_tilt", None, "roll"): (0.3, 0.0, 0.0),
    ("base_tilt", None, "pitch"): (0.0, 0.3, 0.0),
}


@pytest.mark.parametrize(("name", "joint", "parameter"), SIZED)
def test_a_size_makes_the_parameters_of_the_law(arm, name, joint, parameter):
    # Closed forms: an excess e of the logged torque is the ratio 1 / (1 + e), a compliance c the stiffness 1 / c.
    theta = effect_named(name).sized(arm, joint, parameter, 0.3, np.array([0.1, 0.2, 0.3]))
    expected = SIZED[name, joint, parameter]
    assert theta == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(("name", "size"), [("torque_constant", -1.0), ("transmission_compliance", 0.0)])
def test_a_size_at_the_pole_of_its_law_makes_no_parameters(arm, name, size):
    effect = effect_named(name)
    probed = "ratio" if name == "torque_constant" else "compliance"
    assert effect.sized(arm, "tilt", probed, size, np.zeros(3)) is None
