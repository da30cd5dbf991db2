"""Compliances that a recording shows by their resonance: known truth of a joint driven by sines and noise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.diagnosis.columns.resonances import resonances
from identification.pipeline import diagnose
from phantom_dyn import load_robot
from phantom_dyn.haptics.device.axis import TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.experiments.relay import held_forces
from phantom_dyn.model.robot import Robot

T = 1e-3
# Rotor 0.05 and link 0.2 kg m2 on 800 N m/rad: they resonate at 22.5 Hz.
JOINT = TwoMassAxis(0.05, 0.2, 0.1, 0.2, 800.0, 0.3)
ROBOT = """<robot name="turntable"><link name="base"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="table"/><axis xyz="0 0 1"/>
<dynamics damping="0.3"/></joint>
<link name="table"><inertial><mass value="2"/><inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/>
</inertial></link></robot>"""


@pytest.fixture
def turntable(tmp_path: Path) -> Robot:
    """The joint as a rigid robot."""
    (tmp_path / "turntable.urdf").write_text(ROBOT)
    (tmp_path / "robot.yaml").write_text("torque_hold: zoh\njoints:\n  j1: {rotor_inertia: 0.05}\n")
    return load_robot(tmp_path / "turntable.urdf")


def driven(noise: float) -> Recording:
    """Twenty seconds of the joint under two slow sines of torque and white noise of that deviation [N m]."""
    rng = np.random.default_rng(3)
    t = T * np.arange(20_000)
    force = noise * rng.standard_normal(len(t)) + 2.0 * np.sin(0.8 * np.pi * t) + np.sin(2.2 * np.pi * t + 1.0)
    s = discretise(JOINT, period=T, delay=0.0)
    q = held_forces(s.transition, s.newer, s.older, s.output, s.steps, JOINT.rest(0.0), force)
    q = q + 1e-5 * rng.standard_normal(len(t))
    return Recording("noise.csv", ("j1",), t, q[:, None], force[:, None])


def test_a_resonance_that_the_drive_excites_gives_the_stiffness(turntable):
    (seen,) = resonances(turntable, process_all((driven(0.5),), turntable)[0])
    assert seen.place == ("transmission_compliance", "j1")
    assert 1.0 / seen.shape[0] == pytest.approx(800.0, rel=0.01)


def test_a_smooth_torque_shows_no_resonance(turntable):
    assert resonances(turntable, process_all((driven(0.0),), turntable)[0]) == ()


def test_an_encoder_behind_the_spring_is_not_asked(turntable):
    (actuator,) = turntable.actuators
    behind = replace(turntable, actuators=(replace(actuator, encoder_side="link"),))
    assert resonances(behind, process_all((driven(0.5),), behind)[0]) == ()


@pytest.mark.whole
def test_the_diagnosis_names_the_spring_with_its_stiffness(turntable):
    # Known truth, within three standard deviations.
    (finding,) = diagnose(turntable, (driven(0.5),)).findings
    assert (finding.effect, finding.joint) == ("transmission_compliance", "j1")
    stiffness = finding.parameters["stiffness"]
    assert np.abs(np.subtract(stiffness.value, 800.0)) < np.multiply(3.0, stiffness.std)
