"""Effects from files, classes and installed packages. Oracles: Python's own compiler and importlib.metadata, one fault
each."""

import sys

import numpy as np
import pytest

from phantom_dyn.effects.author import LawEffect, Parameter, torque_on_joint
from phantom_dyn.effects.catalogue import EFFECTS, effect_named, effects_of, known_effect
from phantom_dyn.effects.user.user_effects import with_user_effects
from phantom_dyn.errors import EffectError, ParameterError

pytestmark = pytest.mark.whole

FILE = '''
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.effects.author import LawEffect, Parameter, row_of, torque_on_joint


@dataclass(frozen=True)
class Sizes:
    power: float = 2.0


SIZES = Sizes()


class Drag(LawEffect):
    """Drag that grows with a power of the speed."""

    name = "drag"

    def parameters(self, robot, joint):
        return (Parameter("coefficient", "N m s^2/rad^2", lower=0.0),)

    def torque(self, robot, operation, joint, theta):
        v = operation.v[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, -theta[0] * np.sign(v) * np.abs(v) ** SIZES.power)
'''


class Pull(LawEffect):
    """A constant pull."""

    name = "pull"

    def parameters(self, robot, joint):
        return (Parameter("torque", "N m"),)

    def torque(self, robot, operation, joint, theta):
        return torque_on_joint(robot, joint, np.full(len(operation.t), theta[0]))


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    return path


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install a package of a name with one entry point and the text of its module, as pip leaves it."""

    def install(point: str, text: str) -> None:
        folder = tmp_path / "site"
        info = folder / "made_up-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: made-up\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[phantom_dyn.effects]\n{point}\n")
        (folder / "made_up_effects.py").write_text(text)
        monkeypatch.syspath_prepend(folder)
        monkeypatch.delitem(sys.modules, "made_up_effects", raising=False)

    yield install
    sys.modules.pop("made_up_effects", None)


def names(robot):
    return [effect.name for effect in robot.user_effects]


def test_the_robot_that_was_given_and_the_catalogue_stay_as_they_are(arm, file):
    before = EFFECTS
    carrying = with_user_effects(arm, file)
    assert (names(carrying), arm.user_effects) == (["drag"], ())
    assert effects_of(arm) == EFFECTS == before
    assert effects_of(carrying) == (*EFFECTS, *carrying.user_effects)


def test_a_name_is_looked_up_among_those_of_the_robot(arm, file):
    carrying = with_user_effects(arm, file)
    assert effect_named("drag", carrying) is carrying.user_effects[0]
    assert (known_effect("drag"), known_effect("drag", arm)) == (None, None)
    with pytest.raises(ParameterError, match=r"Unknown effect 'drag'.*One of your own needs its file"):
        effect_named("drag", arm)


def test_files_classes_and_effects_go_together(arm, file):
    class Push(Pull):
        name = "push"

    assert names(with_user_effects(arm, [file, Pull, Push()])) == ["drag", "pull", "push"]
    assert names(with_user_effects(with_user_effects(arm, str(file)), Pull)) == ["drag", "pull"]


def test_a_base_class_in_a_file_is_no_effect_of_its_own(arm, file):
    file.write_text(FILE + "\n\nclass Worse(Drag):\n    name = 'worse_drag'\n")
    assert names(with_user_effects(arm, file)) == ["worse_drag"]


def test_the_module_of_a_file_is_nobody_elses(arm, file):
    before = set(sys.modules)
    made = with_user_effects(arm, file).user_effects[0]
    assert type(made).__module__ not in sys.modules
    assert set(sys.modules) == before


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("class :", r"mine\.py is no Python \(SyntaxError in line 1: .*\), wanted a file with classes of effects"),
        ("a\0b", r"mine\.py is no Python \(.*\), wanted a file"),
        ("x = 1\nimport no_such_thing", r"mine\.py cannot be run \(ModuleNotFoundError: .*no_such_thing.*\) in line 2"),
        ("raise SystemExit(3)", r"mine\.py cannot be run \(SystemExit: 3\) in line 1"),
        ("x = 1", r"mine\.py defines no effect, wanted a class of LawEffect or Effect from"),
        ("from phantom_dyn.effects.author import LawEffect", r"mine\.py defines no effect"),
        (FILE.replace("def torque", "def other"), r"mine\.py: class Drag lacks torque: write it"),
        (FILE.replace('"drag"', '"payload"'), "has the name payload, which the catalogue has already: give"),
        (FILE + "\n\nclass More(LawEffect):\n    name = 'drag'\n    parameters = Drag.parameters\n"
         "    torque = Drag.torque\n", r"More has the name drag, which .*class Drag brings already"),
        (FILE + "\n    def __init__(self, size):\n        pass\n",
         r"class Drag cannot be made \(TypeError: .*size.*\), wanted a class that takes no arguments"),
        (FILE.replace('    name = "drag"\n', ""), "class Drag has no name, wanted one of small letters"),
        (FILE.replace("-theta[0] *", "np.nan *"), "class Drag: torque gave values that are not finite"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_one_sentence(arm, file, text, said):
    file.write_text(text)
    with pytest.raises(EffectError, match=said) as refused:
        with_user_effects(arm, file)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_refused(arm, tmp_path):
    with pytest.raises(EffectError, match=r"none\.py cannot be read \(No such file or directory\), wanted"):
        with_user_effects(arm, tmp_path / "none.py")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (3, "3 was given as an effect, wanted the path of a Python file, a class or an instance"),
        (dict, "class dict is no effect, wanted a class of LawEffect or Effect from phantom_dyn"),
        (LawEffect, "class LawEffect lacks parameters, torque: write them"),
    ],
)
def test_what_is_no_effect_is_refused(arm, given, said):
    with pytest.raises(EffectError, match=said):
        with_user_effects(arm, given)


@pytest.mark.parametrize("target", ["Drag", "BOTH"])
def test_an_installed_package_adds_its_effects(arm, installed, target):
    text = FILE + "\n\nclass Other(Drag):\n    name = 'other_drag'\n\n\nBOTH = (Drag, Other())\n"
    installed(f"mine = made_up_effects:{target}", text)
    wanted = ["drag"] if target == "Drag" else ["drag", "other_drag"]
    carrying = with_user_effects(arm)
    assert names(carrying) == wanted
    assert with_user_effects(carrying) is carrying


@pytest.mark.parametrize(
    ("point", "said"),
    [
        ("mine = made_up_effects:Nothing", r"cannot be loaded \(AttributeError: .*Nothing.*\): mend or uninstall"),
        ("mine = no_such_module:Drag", r"cannot be loaded \(ModuleNotFoundError: .*\): mend or uninstall that package"),
        ("mine = made_up_effects:SIZES", r"offers Sizes\(power=2.0\), wanted a class of LawEffect or Effect"),
        ("mine = made_up_effects:Taken", r"has the name payload, which the catalogue has already"),
    ],
)
def test_a_broken_package_is_named(arm, installed, point, said):
    installed(point, FILE + "\n\nclass Taken(Drag):\n    name = 'payload'\n")
    with pytest.raises(EffectError, match=f"The plug-in mine of the package made-up {said}"):
        with_user_effects(arm)


def test_a_file_may_not_take_the_name_of_an_installed_effect(arm, file, installed):
    installed("mine = made_up_effects:Drag", FILE)
    with pytest.raises(EffectError, match=r"has the name drag, which The plug-in mine of .* brings already"):
        with_user_effects(arm, file)
