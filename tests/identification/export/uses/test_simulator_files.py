"""Joints in the words of simulators. Oracles: the findings themselves, read back by Python and YAML."""

from __future__ import annotations

import ast
import sys
from types import ModuleType

import pytest
import yaml

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_model import CorrectedModel, corrected_model
from identification.export.uses.simulator_files import isaac_lab_text, simulators_text


@pytest.fixture
def corrected(planar) -> CorrectedModel:
    found = (
        KnownEffect("coulomb_friction", "elbow", (0.7,)),
        KnownEffect("viscous_friction", "shoulder", (0.3,)),
        KnownEffect("rotor_inertia", "elbow", (0.05,)),
        KnownEffect("torque_saturation", "shoulder", (9.0,)),
        KnownEffect("input_delay", "elbow", (0.0101,)),
        KnownEffect("parasitic_spring", "elbow", (3.0, 0.2)),
        KnownEffect("backlash", "elbow", (0.04,)),
    )
    return corrected_model(planar, found)


class _Cfg:
    """Stands for DelayedPDActuatorCfg: it keeps what it is given."""

    def __init__(self, **fields):
        self.fields = fields


@pytest.fixture
def groups(corrected, monkeypatch):
    package, actuators = ModuleType("isaaclab"), ModuleType("isaaclab.actuators")
    actuators.DelayedPDActuatorCfg = _Cfg  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "isaaclab", package)
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", actuators)
    scope: dict = {}
    exec(compile(isaac_lab_text(corrected, "arm"), "isaac_lab.py", "exec"), scope)
    return scope["actuators"](0.005, 40.0, {"shoulder": 1.0, "elbow": 2.0})


def test_friction_rotors_and_limits_of_isaac_lab_are_the_corrected_ones(groups, planar):
    elbow, shoulder = groups["elbow"].fields, groups["shoulder"].fields
    assert elbow["friction"] == elbow["dynamic_friction"] == pytest.approx(planar.coulomb_friction[1] + 0.7)
    assert elbow["armature"] == pytest.approx(planar.rotor_inertia[1] + 0.05)
    assert shoulder["viscous_friction"] == pytest.approx(planar.viscous_friction[0] + 0.3)
    assert shoulder["effort_limit"] == 9.0
    assert elbow["effort_limit"] == 20.0  # as its URDF states


def test_a_delay_is_in_whole_physics_steps_of_its_joint_alone(groups):
    delays = {joint: (group.fields["min_delay"], group.fields["max_delay"]) for joint, group in groups.items()}
    assert delays == {"shoulder": (0, 0), "elbow": (2, 2)}


def test_gains_are_those_that_the_user_gives(groups):
    assert (groups["elbow"].fields["stiffness"], groups["elbow"].fields["damping"]) == (40.0, 2.0)


def test_what_isaac_lab_cannot_say_is_in_the_docstring(corrected):
    said = " ".join(str(ast.get_docstring(ast.parse(isaac_lab_text(corrected, "arm")))).split())
    assert "Isaac Lab has no place for play: elbow 0.04." in said
    assert "Isaac Lab has no place for spring: elbow 3." in said
    assert "no place for delay" not in said


def test_a_name_with_quotes_leaves_a_file_that_python_reads(corrected):
    assert ast.parse(isaac_lab_text(corrected, 'an "arm" """\\'))


def test_each_section_has_the_numbers_that_its_simulator_holds(corrected, planar):
    found = yaml.safe_load(simulators_text(corrected, "arm"))
    friction = pytest.approx(planar.coulomb_friction[1] + 0.7)
    elbow = found["gazebo"]["joints"]["elbow"]
    assert (elbow["friction"], elbow["spring_stiffness"], elbow["spring_reference"]) == (friction, 3.0, 0.2)
    assert found["drake"]["joints"]["elbow"]["rotor_inertia"] == pytest.approx(planar.rotor_inertia[1] + 0.05)
    assert found["ros2_control"]["joint_limits"]["shoulder"] == {"has_effort_limits": True, "max_effort": 9.0}


def test_limits_of_the_given_file_are_there_where_none_was_found(corrected):
    # Oracle: the effort of planar2.urdf.
    found = yaml.safe_load(simulators_text(corrected, "arm"))
    assert found["ros2_control"]["joint_limits"]["elbow"] == {"has_effort_limits": True, "max_effort": 20.0}
    assert [found[name]["joints"]["elbow"]["effort"] for name in ("gazebo", "drake")] == [20.0, 20.0]


def test_each_section_says_what_it_has_no_place_for(corrected):
    found = yaml.safe_load(simulators_text(corrected, "arm"))
    assert any("Drake has no place for Coulomb friction" in s and "elbow" in s for s in found["drake"]["cannot_say"])
    assert "Gazebo (SDF) has no place for delay: elbow 0.0101." in found["gazebo"]["cannot_say"]
    assert any("ros2_control has no place for viscous friction" in s for s in found["ros2_control"]["cannot_say"])


def test_a_late_reference_is_the_delay_of_the_command_in_isaac_lab(planar, monkeypatch):
    package, actuators = ModuleType("isaaclab"), ModuleType("isaaclab.actuators")
    actuators.DelayedPDActuatorCfg = _Cfg  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "isaaclab", package)
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", actuators)
    late = corrected_model(planar, (KnownEffect("reference_delay", None, (0.03,)),))
    scope: dict = {}
    exec(compile(isaac_lab_text(late, "arm"), "isaac_lab.py", "exec"), scope)
    groups = scope["actuators"](0.005, 40.0, 1.0)
    # By hand: six steps of 5 ms.
    assert {name: group.fields["min_delay"] for name, group in groups.items()} == {"shoulder": 6, "elbow": 6}
