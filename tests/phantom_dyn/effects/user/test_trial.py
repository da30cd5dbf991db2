"""What is wrong with an effect is said before it is used. Oracles: the catalogue's own effects, and one fault each."""

import re

import numpy as np
import pytest

from phantom_dyn.effects.author import (
    Effect,
    EffectWords,
    LawEffect,
    Parameter,
    Simulated,
    on_one_joint,
    row_of,
    torque_on_joint,
)
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.user.trial import tried
from phantom_dyn.errors import EffectError

# Effects that are made wrong on purpose would not pass the checks of annotations.
pytestmark = pytest.mark.whole


class Drag(LawEffect):
    """Nothing is wrong with this one."""

    name = "drag"

    def parameters(self, robot, joint):
        return (Parameter("coefficient", "N m s^2/rad^2", 0.0, plausible=(0.0, 2.0)),)

    def torque(self, robot, operation, joint, theta):
        v = operation.v[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, -theta[0] * v * np.abs(v))


class Fading(Drag):
    """With a speed that the torque is not linear in."""

    def parameters(self, robot, joint):
        return Parameter("torque", "N m", 0.0), Parameter("speed", "rad/s", 0.0, tried=(0.5, 2.0))

    def torque(self, robot, operation, joint, theta):
        v = operation.v[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, -theta[0] * np.tanh(v / theta[1]))


def refusal(effect, robot):
    with pytest.raises(EffectError) as refused:
        tried(effect, robot, "x.py: class Drag")
    text = str(refused.value)
    assert text.startswith("x.py: class Drag")
    return text


def parts(law):
    """A class of Drag with another torque on the joint."""

    class Other(Drag):
        def torque(self, robot, operation, joint, theta):
            return torque_on_joint(robot, joint, law(operation, row_of(robot, joint), theta))

    return Other


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_every_effect_of_the_catalogue_passes(arm, effect):
    assert tried(effect, arm, "catalogue") is effect


@pytest.mark.parametrize("effect", [Drag(), Fading()], ids=lambda effect: type(effect).__name__)
def test_a_law_alone_passes(arm, effect):
    assert tried(effect, arm, "x.py") is effect


@pytest.mark.parametrize(
    ("attributes", "said"),
    [
        ({"name": None}, "has no name, wanted one of small letters.*name = "),
        ({"name": "Belt slip"}, "has the name 'Belt slip', wanted one of small letters"),
        ({"regime": "fast"}, "has the regime 'fast', wanted one of velocity_reversal, low_speed"),
        ({"words": "slips"}, "has a str as words, wanted EffectWords"),
        (
            {"words": EffectWords("a", "b", "c", size="of {size}")},
            r"size names \{size\}, wanted.*coefficient",
        ),
    ],
)
def test_a_wrong_attribute_is_named(arm, attributes, said):
    wrong = type("Wrong", (Drag,), attributes)()
    assert re.search(said, refusal(wrong, arm))


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        (None, "parameters gave nothing, wanted a tuple of Parameter"),
        ((), "parameters gave a tuple, wanted a tuple of Parameter"),
        ((Parameter("c", "1"), Parameter("c", "1")), "has parameters c, c, wanted each name once"),
        ((Parameter("c", "1", 2.0, 1.0),), "c may be from 2 to 1, wanted lower below upper"),
        ((Parameter("c", "1", 0.0, plausible=(-1.0, 1.0)),), "c is plausible from -1 to 1, wanted a range within"),
        (
            (Parameter("c", "1", tried=(0.0, 1.0)),),
            "c is to be tried at (0.0, 1.0), wanted possible numbers",
        ),
        ((Parameter("c", "1", 0.0, tried=(-1.0,)),), "c is to be tried at (-1.0,), wanted possible numbers"),
        ((Parameter("c", "1", tried=(np.nan,)),), "c is to be tried at (nan,), wanted possible numbers"),
        ((Parameter("c", "1", tried=(1.0,)),), "is linear in none of its parameters c: write the law with a factor"),
    ],
)
def test_wrong_parameters_are_named(arm, parameters, said):
    wrong = type("Wrong", (Drag,), {"parameters": lambda self, robot, joint: parameters})()
    assert said in refusal(wrong, arm)


@pytest.mark.parametrize(
    ("method", "made", "said"),
    [
        (
            "torque",
            lambda self, robot, operation, joint, theta: operation.v[:, 0],
            "torque gave shape (64,), wanted an array of shape (64, 3), a row a sample",
        ),
        (
            "torque",
            lambda self, robot, operation, joint, theta: -theta[0] * operation.v,
            "its torque on turn acts on other joints too, wanted zero there",
        ),
        ("simulated", lambda self, robot, joint, theta: None, "simulated gave nothing, wanted a Simulated"),
    ],
    ids=["another shape", "another joint", "no simulated"],
)
def test_a_method_that_gives_something_else_is_refused_with_what_was_wanted(arm, method, made, said):
    assert said in refusal(type("Wrong", (Drag,), {method: made})(), arm)


def test_a_torque_that_is_not_finite_is_refused_with_its_parameters(arm):
    with np.errstate(invalid="ignore"):
        text = refusal(parts(lambda operation, row, theta: theta[0] * np.sqrt(operation.v[:, row]))(), arm)
    assert "torque gave values that are not finite on turn for parameters" in text


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (
            lambda operation, row, theta: theta[1] * operation.v[:, row],
            "torque raised IndexError: index 1 is out of bounds",
        ),
        (
            lambda operation, row, theta: np.cos(theta[0] * operation.q[:, row]),
            "its torque is not zero where coefficient is zero",
        ),
        (
            lambda operation, row, theta: np.sin(theta[0] * operation.q[:, row]),
            "its torque is not linear in coefficient: give that one values to try, as in Param",
        ),
    ],
    ids=["an error", "there without being there", "not linear"],
)
def test_a_law_that_cannot_be_fitted_is_refused_with_the_reason(arm, law, said):
    assert said in refusal(parts(law)(), arm)


def test_parameters_that_multiply_each_other_are_named(arm):
    class Product(Fading):
        def parameters(self, robot, joint):
            return Parameter("torque", "N m"), Parameter("speed", "rad/s")

        def torque(self, robot, operation, joint, theta):
            return torque_on_joint(robot, joint, -theta[0] * theta[1] * operation.v[:, row_of(robot, joint)])

    assert "its torque is no sum over torque, speed, as one multiplies another" in refusal(Product(), arm)


def test_accelerations_and_the_torque_of_the_model_have_to_be_said(arm):
    inertia = parts(lambda operation, row, theta: -theta[0] * operation.a[:, row])
    assert "add 'acceleration' to made_of" in refusal(inertia(), arm)
    load = parts(lambda operation, row, theta: -theta[0] * operation.transmitted[:, row])
    assert "add 'model' to made_of" in refusal(load(), arm)
    for attribute, value in (("made_of", ("model",)), ("follows_model", True)):  # the second is how older files say it
        said = type("Said", (load,), {attribute: value})()
        assert said.follows_model
        assert tried(said, arm, "x.py") is said


@pytest.mark.parametrize(
    "law",
    [
        lambda operation, row, theta: -theta[0] * operation.a[:, row],
        lambda operation, row, theta: -theta[0] * np.roll(operation.v[:, row], 1),
        lambda operation, row, theta: -theta[0] * np.gradient(operation.v[:, row], operation.t),
    ],
    ids=["acceleration", "sample before", "gradient"],
)
def test_a_law_that_no_simulation_can_step_through_needs_one_of_its_own(arm, law):
    wrong = type("Wrong", (parts(law),), {"made_of": ("acceleration",)})
    assert "needs the acceleration or other samples" in refusal(wrong(), arm)
    right = type("Right", (wrong,), {"simulated": lambda self, robot, joint, theta: Simulated()})()
    assert tried(right, arm, "x.py") is right


class Whole(Effect):
    """Columns and law of an author; ``sign`` is that of the columns."""

    name = "whole"
    regime = "high_speed"
    words = EffectWords("whole", "whole", "Look.")

    def __init__(self, sign=1.0, columns=None):
        self.sign, self.columns = sign, columns

    def parameters(self, robot, joint):
        return (Parameter("coefficient", "N m s/rad"),)

    def signature(self, robot, operation, joint, shape):
        made = self.sign * operation.v[:, row_of(robot, joint)]
        return self.columns or on_one_joint(robot, joint, coefficient=(made, "N m s/rad"))

    def torque(self, robot, operation, joint, theta):
        return torque_on_joint(robot, joint, -theta[0] * operation.v[:, row_of(robot, joint)])

    def simulated(self, robot, joint, theta):
        return Simulated()


def test_columns_of_the_wrong_sign_are_refused(arm):
    assert tried(Whole(), arm, "x.py")
    text = refusal(Whole(-1.0), arm)
    assert "signature and torque are of different laws on turn, wanted columns @ coefficients = -torque" in text


def test_columns_that_are_no_signature_are_refused(arm):
    assert "signature gave a str, wanted a Signature" in refusal(Whole(columns="v"), arm)
    short = on_one_joint(arm, "turn", coefficient=(np.zeros(5), "1"))
    assert "signature gave columns of shape (5, 1, 1), wanted (64, 1, 1)" in refusal(Whole(columns=short), arm)
