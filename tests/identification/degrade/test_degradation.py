from __future__ import annotations

import pytest

from identification.degrade.degradation import degradation
from phantom_dyn.errors import ParameterError


@pytest.mark.parametrize(
    ("effect", "joint", "values", "theta"),
    [
        ("coulomb_friction", "tilt", {"torque": (0.3,)}, (0.3,)),
        ("cogging", "tilt", {"amplitude": (0.1, 0.2), "order": (6, 12), "phase": (0, 1)}, (6, 12, 0.1, 0.2, 0, 1)),
        ("encoder_eccentricity", "tilt", {"amplitude": (0.01,), "phase": (0.5,)}, (0.01, 0.5, 1.0)),
        ("presliding_friction", "tilt", {"torque": (0.5,), "displacement": (0.01,)}, (0.5, 0.01)),
        (
            "presliding_friction",
            "tilt",
            {"torque": (0.5,), "displacement": (0.01,), "static_ratio": (1.05,), "stick_velocity": (0.1,)},
            (0.5, 0.01, 1.05, 0.1),
        ),
        ("inertial_parameters", "slide", {"slide.m": (0.2,)}, (0.2, *(0.0,) * 9)),
        ("input_delay", None, {"delay": (0.004,)}, (0.004,)),
        ("payload", None, {"mass": (1,), "center_x": (0,), "center_y": (0,), "center_z": (0.1,)}, (1, 0, 0, 0.1)),
    ],
)
def test_parameters_come_in_the_contracts_order(arm, effect, joint, values, theta):
    # Contract: the table of effects; one cycle per turn of an eccentric disc, and what is not named did not move.
    made = degradation(arm, effect, joint, values)
    assert (made.effect.name, made.joint, made.theta) == (effect, joint, theta)


@pytest.mark.parametrize(
    ("effect", "joint", "values", "words"),
    [
        ("friction", "tilt", {}, "Unknown effect 'friction': the effects are viscous_friction, coulomb_friction"),
        ("coulomb_friction", "wrist", {}, "coulomb_friction needs a place and 'wrist' was given: give one of turn, ti"),
        ("coulomb_friction", None, {}, "coulomb_friction needs a place and no joint was given: give one of turn"),
        (
            "joint_coupling",
            "tilt+tilt",
            {},
            "joint_coupling needs a place and 'tilt.tilt' was given: give",
        ),
        ("payload", "tilt", {}, "payload is of the whole robot, not of joint 'tilt': leave the joint out"),
        (
            "coulomb_friction",
            "slide",
            {"force": (1.0,)},
            r"has no parameter 'force': the parameters of coulomb_friction are torque \[N\] of -3 or more",
        ),
        (
            "backlash",
            "tilt",
            {},
            r"backlash lacks its parameter gap: the parameters of backlash are gap \[rad\] of 0 or more",
        ),
        (
            "backlash",
            "tilt",
            {"gap": (-0.1,)},
            r"gap=-0.1 of backlash is out of bounds: wanted gap \[rad\] of 0",
        ),
        ("base_tilt", None, {"roll": (2.0,), "pitch": (0.0,)}, r"wanted roll \[rad\] from -1.571 to 1.571"),
        ("backlash", "tilt", {"gap": (0.1, 0.2)}, "gap of backlash was given 2 numbers: it takes one"),
        (
            "cogging",
            "tilt",
            {"order": (6, 12), "amplitude": (0.1,), "phase": (0.0,)},
            "cogging was given 2 of order, 1 of amplitude, 1 of phase: give as many numbers of each",
        ),
        ("encoder_quantization", "tilt", {"step": (0.0,)}, "step=0 of encoder_quantization .* wanted a number above 0"),
        ("transmission_compliance", "tilt", {"stiffness": (0.0,)}, "stiffness=0 of transmission_compliance is out"),
        (
            "presliding_friction",
            "tilt",
            {"torque": (0.5,), "displacement": (0.01,), "static_ratio": (1.05,)},
            "presliding_friction lacks its parameter stick_velocity",
        ),
    ],
)
def test_a_refusal_says_what_there_is(arm, effect, joint, values, words):
    with pytest.raises(ParameterError, match=words):
        degradation(arm, effect, joint, values)
