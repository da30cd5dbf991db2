"""Torque that is read once per held reference looks like viscous friction. Oracle: a sawtooth by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.judge.findings.held_torque import held_references_imitate
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Controller

KP, ROW = 60.0, 0.01


def session_of(robot, reference_gain=None, kp=KP, held=False):
    drives = tuple(replace(drive, controller=Controller("pd", kp, 1.5) if kp else None) for drive in robot.actuators)
    recording = SimpleNamespace(t=ROW * np.arange(100), reference_gain=reference_gain, references_held=held)
    return SimpleNamespace(robot=replace(robot, actuators=drives), recordings=(recording,))


def term_of(effect, joint):
    return SimpleNamespace(effect=effect_named(effect), joint=joint)


def sawtooth_friction():
    """Slope over the velocity of what a torque read at the end of each row lacks against the mean of the row."""
    v = np.linspace(-1.0, 1.0, 21)
    within = np.linspace(0.0, ROW, 1001)
    torque = KP * (0.3 - v * within[:, None])
    return np.polyfit(v, torque[-1] - torque.mean(axis=0), 1)[0]


def test_the_sawtooth_of_a_held_reference_may_be_what_looks_like_viscous_friction(planar2):
    session, term = session_of(planar2), term_of("viscous_friction", planar2.joint_names[1])
    for sign in (-1.0, 1.0):
        assert held_references_imitate(session, term, sign * np.array([sawtooth_friction()]))
    assert not held_references_imitate(session, term, np.array([2.0 * sawtooth_friction()]))


@pytest.mark.parametrize(
    ("effect", "case"),
    [
        ("coulomb_friction", {}),
        ("viscous_friction", {"kp": 0.0}),
        # A torque that was computed from the references was not read.
        ("viscous_friction", {"reference_gain": np.array([KP, KP])}),
    ],
)
def test_no_other_effect_and_no_other_drive_is_doubted_by_it(planar2, effect, case):
    term = term_of(effect, planar2.joint_names[1])
    assert not held_references_imitate(session_of(planar2, **case), term, np.array([0.1]))


@pytest.mark.parametrize(("rows", "held", "doubted"), [(0.5, False, True), (1.0, False, False), (0.5, True, False)])
def test_a_reference_that_is_late_by_half_a_row_may_be_held(planar2, rows, held, doubted):
    # By hand: a reference that is held for a row is half a row late on average, unless the hold was counted already.
    session = session_of(planar2, np.array([KP, KP]), held=held)
    assert held_references_imitate(session, term_of("reference_delay", None), np.array([rows * ROW])) == doubted
