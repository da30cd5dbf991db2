"""Compiled simulation: chain, motion, links."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from forward_dynamics import forward_dynamics
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.simulated import Simulated
from phantom_dyn.errors import ChainError, ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation import compiled_machine as simulation_machine
from phantom_dyn.simulation import simulate as simulation
from phantom_dyn.simulation.compiled_machine import compiled
from phantom_dyn.simulation.control import position_control, torque_over_time
from phantom_dyn.simulation.simulate import Cause, Simulation, simulate
from phantom_dyn.simulation.stepping import machine_of
from places import ROBOTS
from sample_sizes import CONTRACT_SIZES, sample_size

SHORT = np.linspace(0.0, 0.02, 9)

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
    wave = 0.3 * np.sin(np.outer(SHORT, 40.0 + 9.0 * np.arange(robot.nv)))
    law = position_control(SHORT, wave, 0 * wave, kp=np.full(robot.nv, 2.0), kd=np.full(robot.nv, 0.05))
    return simulate(robot, causes, law, SHORT, np.full(robot.nv, 0.1), np.full(robot.nv, -0.2), max_step=1e-3)


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
    assert compiled(machine, (), SHORT, np.ones(len(SHORT), np.int64)) is not None


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


NAMES = [effect.name for effect in EFFECTS]

STICK = [0.6, 0.02, 1.4, 0.05]

SECONDS = np.linspace(0.0, 0.1, 21)


def tied(robot, *, hold="instant", source="command", rotor=0.1):
    """The robot with rotors everywhere."""
    model = robot.model.copy()
    model.armature = np.full(robot.nv, rotor)
    return replace(robot, model=model, torque_hold=hold, torque_source=source)


def cause(robot, name, theta=None) -> Cause:
    """An effect on the robot's last joint, on its first two, or on all of it."""
    effect = effect_named(name)
    joint = None if effect.scope == "robot" else robot.joint_names[-1]
    if name == "joint_coupling":
        joint = "+".join(robot.joint_names[:2])
    theta = CONTRACT_SIZES.get(name) if theta is None else theta
    return Cause(effect, joint, np.array(theta or list(sample_size(effect, robot, joint).values())))


def controller_of(robot):
    """Gains and a wave that reverse each joint."""
    t = np.linspace(0.0, 1.0, 400)
    omega = 20.0 + 9.0 * np.arange(robot.nv)
    wave = 0.2 * np.sin(np.outer(t, omega) + 0.3), 0.2 * omega * np.cos(np.outer(t, omega) + 0.3)
    return position_control(t, *wave, kp=np.full(robot.nv, 150.0), kd=np.full(robot.nv, 9.0))


def in_python(monkeypatch, *args, **options) -> Simulation:
    """The same simulation without compiled steps."""
    with monkeypatch.context() as patch:
        patch.setattr(simulation, "compiled", lambda *given: None)
        return simulate(*args, **options)


def assert_same(a: Simulation, b: Simulation, tolerance=1e-9):
    for part in ("q", "tau"):
        np.testing.assert_allclose(getattr(a, part), getattr(b, part), atol=tolerance)
    for side in ("links", "encoders"):
        for part, scale in (("q", 1.0), ("v", 10.0), ("a", 1e4)):
            one, other = getattr(getattr(a, side), part), getattr(getattr(b, side), part)
            np.testing.assert_allclose(one, other, atol=tolerance * scale)


@pytest.fixture(scope="module")
def arm():
    """Two hinges and a slide."""
    return tied(load_robot(ROBOTS / "arm3.urdf"))


def robots_of(name: str) -> list[str]:
    return ["planar2", "arm3"] if name == "joint_coupling" else ["pendulum", "planar2"]


@pytest.mark.parametrize(("name", "file"), [(name, file) for name in NAMES for file in robots_of(name)])
def test_an_effect_moves_the_robot_as_without_compiled_steps(name, file, monkeypatch):
    robot = tied(load_robot(ROBOTS / f"{file}.urdf"))
    args = robot, (cause(robot, name),), controller_of(robot), SECONDS, np.zeros(robot.nv)
    assert_same(simulate(*args), in_python(monkeypatch, *args))


@pytest.mark.parametrize("file", ["pendulum", "arm3"])
@pytest.mark.parametrize(("hold", "source"), [("zoh", "command"), ("zoh", "sensor"), ("instant", "sensor")])
def test_stick_play_delay_lag_and_offset_together_move_as_without_compiled_steps(file, hold, source, monkeypatch):
    robot = tied(load_robot(ROBOTS / f"{file}.urdf"), hold=hold, source=source)
    names = ("backlash", "input_delay", "actuator_lag", "torque_saturation", "encoder_offset", "stribeck_friction")
    causes = (cause(robot, "presliding_friction", STICK), *(cause(robot, name) for name in names))
    args = robot, causes, controller_of(robot), SECONDS, np.full(robot.nv, 0.1), np.full(robot.nv, -0.2)
    assert_same(simulate(*args), in_python(monkeypatch, *args))


@pytest.mark.parametrize("hold", ["zoh", "instant"])
@pytest.mark.parametrize("file", ["pendulum", "arm3"])
def test_a_tracking_law_moves_the_robot_as_the_same_law_in_python(file, hold):
    robot = tied(load_robot(ROBOTS / f"{file}.urdf"), hold=hold)
    names = ("input_delay", "encoder_offset", "encoder_eccentricity", "transmission_compliance")
    causes, law = tuple(cause(robot, name) for name in names), controller_of(robot)
    law = replace(law, limits=np.full(robot.nv, 8.0), extra=np.full_like(law.extra, 0.3))
    start = SECONDS, np.zeros(robot.nv)
    assert_same(simulate(robot, causes, law, *start), simulate(robot, causes, lambda *x: law(*x), *start), 1e-12)


def test_every_effect_with_a_compiled_law_is_compiled(arm):
    # Nothing falls back to Python without being seen; an effect whose author gives a law in Python alone has none.
    for name in NAMES:
        one = cause(arm, name)
        part = one.effect.simulated(arm, one.joint, one.theta)
        if name not in CONTRACT_SIZES and not part.laws:
            continue
        counts = np.ones(3, np.int64)
        machine = simulation.machine_of(arm, () if part.transmission is None else (part.transmission,))
        assert simulation_machine.compiled(machine, (part,), np.arange(3.0), counts) is not None, name


def test_an_effect_with_a_law_in_python_only_still_acts(arm, monkeypatch):
    offset = effect_named("torque_offset")
    whole = Cause(offset, "tilt", np.array([0.4]))
    args = controller_of(arm), SECONDS, np.zeros(3)
    expected = simulate(arm, (whole,), *args)
    full = type(offset).simulated

    def without_laws(self, *given) -> Simulated:
        return replace(full(self, *given), laws=())

    monkeypatch.setattr(type(offset), "simulated", without_laws)
    assert_same(simulate(arm, (whole,), *args), expected)


def test_a_closed_chain_starts_with_the_acceleration_of_its_forward_dynamics():
    chain = load_robot("phantom_1_5")
    chain = replace(chain, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    push = torque_over_time(SECONDS[:2], np.full((2, 3), 0.1))
    s = simulate(chain, (), push, np.array([0.0, 1e-5]), np.full(3, 0.1))
    still = np.full((1, 3), 0.1), np.zeros((1, 3))
    np.testing.assert_allclose(s.links.v[1:] / 1e-5, forward_dynamics(chain, *still, np.full((1, 3), 0.1)), rtol=1e-3)


def test_an_inertia_that_couples_two_joints_takes_its_torque(arm):
    frictionless = replace(arm, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    theta = np.array([-0.7, 0.0, 0.0, 0.4])
    coupling = Cause(effect_named("joint_coupling"), "turn+tilt", theta)
    s = simulate(frictionless, (coupling,), controller_of(arm), SECONDS, np.zeros(3))
    law = coupling.effect.torque(arm, Operation.of(frictionless, s.links), "turn+tilt", theta)
    error = (s.tau - inverse_dynamics(frictionless, s.links) + law)[1:-1]
    assert np.abs(error).max() < 0.01 * np.abs(law).max()


def test_a_delay_holds_over_uneven_samples(rng, monkeypatch):
    wheel = tied(load_robot(ROBOTS / "pendulum.urdf"), hold="zoh")
    t = np.cumsum(rng.uniform(1e-4, 2e-2, 60))
    law = torque_over_time(t, rng.normal(size=(60, 1)))
    args = wheel, (cause(wheel, "input_delay", [0.05]),), law, t, np.zeros(1)
    assert_same(simulate(*args), in_python(monkeypatch, *args))


def test_two_threads_move_robots_as_one_does(arm, pendulum):
    robots = [replace(arm, torque_hold="zoh"), tied(pendulum)] * 2
    t = np.linspace(0.0, 0.3, 61)

    def run(robot):
        causes = tuple(cause(robot, name) for name in ("input_delay", "presliding_friction", "backlash"))
        return simulate(robot, causes, controller_of(robot), t, np.zeros(robot.nv))

    alone = [run(robot) for robot in robots]
    with ThreadPoolExecutor(2) as threads:
        together = list(threads.map(run, robots))
    for one, other in zip(alone, together, strict=True):
        assert_same(one, other, 0.0)


@pytest.mark.parametrize("file", ["pendulum", "arm3"])
def test_a_compiled_motion_that_leaves_all_bounds_is_refused(file):
    robot = load_robot(ROBOTS / f"{file}.urdf")
    push = torque_over_time(np.array([0.0, 1.0]), np.full((2, robot.nv), 1e12))
    with pytest.raises(ParameterError, match=r"The motion leaves all bounds after 0 s"):
        simulate(robot, (), push, SECONDS, np.zeros(robot.nv))
