"""What lies between the logged torque and the links in the sealed cases: closed forms."""

# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from benchmarks.gapbench.generator.channel import Drive
from benchmarks.gapbench.generator.drives import draw_table
from benchmarks.gapbench.generator.laws import laws_of
from benchmarks.gapbench.generator.plant import Channel, Plant, compiled

DT, STEP = 2e-3, 5e-4


def sent(channel, commands):
    """What the drive makes of held torques, one value per simulation step."""
    held: list[float] = []
    drive, out = Drive(channel, held, DT, STEP), []
    for k, command in enumerate(commands):
        held.append(float(command))
        out += [drive.torque(k + i * STEP / DT) for i in range(round(DT / STEP))]
    return np.array(out)


def test_a_delayed_torque_keeps_its_mean_to_the_fraction_of_a_step(rng):
    """Closed form: the integral of the hold, shifted."""
    commands, delay = rng.normal(size=50), 3.3e-3
    edges = np.arange(51) * DT
    integral = np.concatenate([[0.0], np.cumsum(commands) * DT])
    t = np.arange(50 * 4 + 1) * STEP - delay
    wanted = np.diff(np.interp(t, edges, integral)) / STEP
    later = t[:-1] > 0.0
    np.testing.assert_allclose(sent(Channel(delay=delay), commands)[later], wanted[later], atol=1e-9)


def test_a_lag_answers_a_step_exponentially():
    """Closed form: the mean of 1 - exp(-t/T) over each step."""
    out, lag = sent(Channel(lag=5e-3), [0.0] + [1.0] * 20)[4:], 5e-3
    t = np.arange(len(out)) * STEP
    wanted = 1.0 - lag / STEP * (np.exp(-t / lag) - np.exp(-(t + STEP) / lag))
    np.testing.assert_allclose(out, wanted, atol=1e-12)


def test_a_drive_clips_before_its_constant_scales():
    np.testing.assert_allclose(sent(Channel(limit=0.5, ratio=1.2), [2.0, -2.0])[[0, 4]], [0.6, -0.6])


def dahl_after(displacement):
    """Friction of a bristle of level 2 and length 0.01 after one slide."""
    table = replace(draw_table(np.random.default_rng(1), "pendulum"))
    law = laws_of(Plant(table, bristles={0: (2.0, 0.01)}), np.zeros(1))[0]
    torque = np.zeros(1)
    for q in np.linspace(0.0, displacement, 50):
        torque[:] = 0.0
        law(SimpleNamespace(qpos=np.array([q])), 0.0, np.zeros(1), torque, np.zeros(1))
    return -float(torque[0])


@pytest.mark.parametrize("displacement", [1e-4, 0.01, -0.02])
def test_presliding_friction_grows_with_displacement_as_dahl_says(displacement):
    wanted = 2.0 * np.sign(displacement) * (1.0 - np.exp(-abs(displacement) / 0.01))
    assert dahl_after(displacement) == pytest.approx(wanted, rel=1e-6)


def settled(plant, torque):
    """Positions after two seconds of a constant drive torque on the only motor, without gravity."""
    model = compiled(plant)
    data = mujoco.MjData(model)
    data.qfrc_applied[plant.drive(0)] = torque
    model.dof_damping[:] = 0.5
    mujoco.mj_step(model, data, 8000)
    return data.qpos.copy()


def held_pendulum(rng, **transmission):
    """A pendulum whose link a stiff spring holds at zero, driven through the transmission."""
    table = draw_table(rng, "pendulum")
    bare = replace(table, gravity=(0.0, 0.0, 0.0), links=(replace(table.links[0], coulomb=0.0),))
    return Plant(bare, springs={0: (1e4, 0.0)}, **transmission)


def test_a_compliant_transmission_twists_by_torque_over_stiffness(rng):
    link, motor = settled(held_pendulum(rng, compliance={0: 80.0}), 0.4)
    assert motor - link == pytest.approx(0.4 / 80.0, rel=1e-3)


@pytest.mark.parametrize("torque", [0.02, -0.02])
def test_a_loose_motor_turns_by_half_the_gap_and_then_carries_the_link(torque, rng):
    link, motor = settled(held_pendulum(rng, gaps={0: 0.02}), torque)
    assert motor - link == pytest.approx(np.sign(torque) * 0.01, abs=2e-4)
    assert link == pytest.approx(torque / 1e4, rel=0.05)


def test_a_motor_behind_a_gap_is_where_the_encoder_and_the_friction_are(rng):
    plant = held_pendulum(rng, gaps={0: 0.02})
    model = compiled(plant)
    assert plant.drive(0) == 1
    assert model.dof_armature[0] == 0.0
    assert model.dof_damping[0] == 0.0
