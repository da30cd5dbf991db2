# pyright: reportAttributeAccessIssue=false
"""Compiled steps of closed chains against the steps of NumPy and Pinocchio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn import load_robot
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation import simulate as simulation
from phantom_dyn.simulation.compiled_machine import compiled
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, Simulation, simulate
from phantom_dyn.simulation.stepping import machine_of
from places import ROBOTS

SECONDS = np.linspace(0.0, 0.02, 9)
LOOPS = {
    "linear": "{kind: linear, active: [crank], passive: {coupler: -crank, rocker: crank}}",
    "point": "{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [crank]}",
}


def loaded(robot: Robot, hold: str = "instant") -> Robot:
    """The robot with rotors and friction on all joints, the passive ones too."""
    rng, model, chain = np.random.default_rng(3), robot.model.copy(), robot.chain
    assert chain is not None
    model.armature = rng.uniform(1e-4, 1e-3, model.nv)
    viscous, coulomb = rng.uniform(1e-3, 5e-3, (2, len(chain.passive)))
    chain = replace(chain, viscous_friction=viscous, coulomb_friction=coulomb)
    return replace(robot, model=model, chain=chain, torque_hold=hold)


def parallelogram(tmp_path: Path, kind: str) -> Robot:
    config = tmp_path / "loop.yaml"
    config.write_text(f"loops: [{LOOPS[kind]}]")
    return loaded(load_robot(ROBOTS / "parallelogram.urdf", config=config))


def run(robot: Robot, *causes: Cause) -> Simulation:
    wave = 0.3 * np.sin(np.outer(SECONDS, 40.0 + 9.0 * np.arange(robot.nv)))
    law = position_control(SECONDS, wave, 0 * wave, kp=np.full(robot.nv, 2.0), kd=np.full(robot.nv, 0.05))
    return simulate(robot, causes, law, SECONDS, np.full(robot.nv, 0.1), np.full(robot.nv, -0.2), max_step=1e-3)


def assert_as_in_python(robot: Robot, monkeypatch, *causes: Cause) -> None:
    found = run(robot, *causes)
    monkeypatch.setattr(simulation, "compiled", lambda *given: None)
    expected = run(robot, *causes)
    np.testing.assert_allclose(found.links.q, expected.links.q, atol=1e-12)
    np.testing.assert_allclose(found.links.v, expected.links.v, atol=1e-10)
    np.testing.assert_allclose(found.tau, expected.tau, atol=1e-12)


@pytest.mark.parametrize("hold", ["zoh", "instant"])
@pytest.mark.parametrize("name", ["phantom_1_5", "cea_branch"])
def test_a_closed_chain_moves_as_without_compiled_steps(name, hold, monkeypatch):
    robot = loaded(load_robot(name), hold)
    first, second = robot.joint_names[:2]
    dry = Cause(effect_named("coulomb_friction"), first, np.array([0.02]))
    play = Cause(effect_named("backlash"), second, np.array([0.01]))
    assert_as_in_python(robot, monkeypatch, dry, play)


def test_friction_found_on_a_passive_joint_brakes_as_without_compiled_steps(monkeypatch):
    robot = loaded(load_robot("phantom_1_5"))
    dry = Cause(effect_named("coulomb_friction"), "elbow", np.array([0.05]))
    assert np.abs(run(robot, dry).links.v - run(robot).links.v).max() > 0.01
    assert_as_in_python(robot, monkeypatch, dry)


def test_a_linkage_with_one_crank_moves_as_without_compiled_steps(tmp_path, monkeypatch):
    assert_as_in_python(parallelogram(tmp_path, "linear"), monkeypatch)


@pytest.mark.nightly
def test_a_parallelogram_moves_alike_whether_its_loop_is_an_expression_or_a_point(tmp_path):
    # The point is solved at every step, the expression is constant.
    linear, point = (run(parallelogram(tmp_path, kind)) for kind in ("linear", "point"))
    np.testing.assert_allclose(linear.links.q, point.links.q, atol=1e-9)


@pytest.mark.parametrize("name", ["fourbar.xml", "fivebar.xml"])
def test_loops_that_are_closed_numerically_move_as_without_compiled_steps(name, monkeypatch):
    robot = loaded(load_robot(ROBOTS / name))
    dry = Cause(effect_named("coulomb_friction"), robot.passive_names[0], np.array([0.02]))
    assert_as_in_python(robot, monkeypatch, dry)


@pytest.mark.parametrize("kind", LOOPS)
def test_expressions_and_points_are_compiled(tmp_path, kind):
    machine = machine_of(parallelogram(tmp_path, kind), ())
    assert compiled(machine, (), SECONDS, np.ones(len(SECONDS), np.int64)) is not None


def falling(robot: Robot, seconds: float) -> Simulation:
    t = np.linspace(0.0, seconds, 200)
    none = np.zeros((len(t), robot.nv))
    law = position_control(t, none, none, kp=np.zeros(robot.nv), kd=np.zeros(robot.nv))
    return simulate(robot, (), law, t, np.full(robot.nv, 0.3), max_step=2e-4)


@pytest.mark.parametrize("name", ["fourbar.xml", "fivebar.xml"])
def test_a_linkage_with_rotors_on_passive_joints_keeps_its_energy_as_it_falls(name):
    # Oracle: Pinocchio's energy of the tree.
    robot = load_robot(ROBOTS / name)
    model = robot.model.copy()
    model.armature = np.full(model.nv, 2e-3)
    robot = replace(robot, model=model)
    m = falling(robot, 0.15).links
    tree, data = tree_motion(robot, m), model.createData()
    energy = [pin.computeMechanicalEnergy(model, data, q, v) for q, v in zip(tree.configuration, tree.v, strict=True)]
    kinetic = 0.5 * (tree.v[-1] ** 2 * 2e-3).sum()
    assert kinetic > 1e-3
    np.testing.assert_allclose(energy, energy[0], atol=1e-4 * kinetic)


def test_a_motion_that_leaves_the_reach_of_a_linkage_is_refused_with_the_loop(tmp_path):
    # Closed form: the rocker of this four-bar swings to and fro, and cannot turn by two radians.
    config = tmp_path / "loop.yaml"
    config.write_text(
        "loops: [{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [rocker], start: {crank: 0.1}}]"
    )
    robot = load_robot(ROBOTS / "fourbar.urdf", config=config)
    start = robot.chain.start[list(robot.chain.active)]
    t = np.linspace(0.0, 1.0, 100)
    wanted = start + 2.0 * np.stack([t], axis=1)
    law = position_control(t, wanted, 0 * wanted, kp=np.full(1, 100.0), kd=np.full(1, 5.0))
    with pytest.raises(ChainError, match=r"After 0\.\d+ s of the simulation: The loop loops\[0\] \(coupler_pin to"):
        simulate(robot, (), law, t, start)
