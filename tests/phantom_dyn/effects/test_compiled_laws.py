"""Laws on scalars, called by their place in a list. Oracle: the same effect stepped in Python over whole arrays."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.catalogue import effect_named
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
from phantom_dyn.effects.drive.input_delay import delay_law
from phantom_dyn.effects.friction.presliding_friction import stick_law
from phantom_dyn.effects.simulated import Law

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
        with pytest.raises(TypeError, match=r"wanted last and what it remembers .* order them so"):
            torque_call("f", names)
