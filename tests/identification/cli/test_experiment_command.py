"""``phantom-dyn experiment``. Oracles: friction and stiffness that the recordings were made with."""

from __future__ import annotations

import json

import matplotlib.image
import numpy as np
import pytest

from identification.cli.main import main
from identification.excitation.motion_shapes import Triangle
from identification.experiments.parallelogram_friction import Friction, friction_test_motion, loop_friction
from identification.experiments.transmission import blocked_arm_loop, triangular_torque
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics

RATE = 500.0


def written(path, joints, t, q, tau):
    head = ["t", *(f"q.{joint}" for joint in joints), *(f"tau.{joint}" for joint in joints)]
    np.savetxt(path, np.column_stack([t, q, tau]), "%.9g", ",", header=",".join(head), comments="")
    return path


@pytest.fixture
def triangles(tmp_path, rng):
    """A pendulum in triangles of four speeds, 0.3 N m s/rad and 0.5 N m of friction beside its weight and inertia."""
    parts = []
    for speed in (0.2, 0.4, 0.8, 1.6):
        frequency = speed / (4 * 0.6)
        parts.append(Triangle(0.6, frequency).motion(np.arange(round(2 / frequency * RATE)) / RATE))
    q, v, a = np.concatenate(parts, axis=1)
    t = np.arange(len(q)) / RATE
    tau = 0.6 * a + 2 * 9.81 * 0.5 * np.sin(q) + 0.3 * v + 0.5 * np.sign(v) + 0.02 * rng.standard_normal(len(t))
    return written(tmp_path / "triangles.csv", ("pin",), t, q, tau)


def results(folder):
    return json.loads((folder / "experiment.json").read_text())["results"]


def test_friction_at_constant_speeds_is_that_of_the_recording(triangles, robots, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["experiment", "friction", str(robots / "pendulum.urdf"), str(triangles), "--out", str(out)]) == 0
    (one,) = results(out)
    for name, truth in (("viscous", 0.3), ("coulomb", 0.5)):
        found = one["parameters"][name]
        assert abs(found["value"] - truth) < max(4 * found["std"], 0.02 * truth)
    told = capsys.readouterr().out
    assert "triangles.csv, pin: viscous 0." in told
    assert "note:" not in told
    assert matplotlib.image.imread(out / "friction.png")[..., :3].min() < 0.5


def test_a_motion_without_constant_speeds_is_said_to_be_no_friction_test(tmp_path, robots, rng, capsys):
    # Closed form: of a sine of frequency f, |a| < |v| / s where |tan(2 pi f t)| < 1 / (2 pi f), for f = 0.5 in 20 % of
    # the time. Known truth: a torque along with the speed, as no friction is.
    t = np.arange(round(20 * RATE)) / RATE
    w = 2 * np.pi * 0.5
    q, v = 0.6 * np.sin(w * t), 0.6 * w * np.cos(w * t)
    tau = 9.81 * np.sin(q) - 0.2 * v - 0.1 * np.sign(v) + 0.02 * rng.standard_normal(len(t))
    log = written(tmp_path / "sine.csv", ("pin",), t, q, tau)
    assert main(["experiment", "friction", str(robots / "pendulum.urdf"), str(log), "--anyway"]) == 0
    told = capsys.readouterr().out
    assert "note: sine.csv, pin: no viscous or coulomb friction is below zero, and" in told
    assert "its speed was constant in 20\N{NO-BREAK SPACE}% of its motion" in told


def test_a_joint_of_the_friction_test_is_not_chosen(triangles, robots, capsys):
    assert main(["experiment", "friction", str(robots / "pendulum.urdf"), str(triangles), "--joint", "pin"]) == 2
    assert "--joint was given with friction, which takes every joint that moves" in capsys.readouterr().err


@pytest.fixture
def held(tmp_path):
    """Loops of two rates: 800 N m/rad, 2 N m s/rad and 0.4 N m of dry friction of a motor against a held arm."""
    out = []
    for name, hertz in (("slow", 0.2), ("fast", 2.0)):
        t = np.arange(round(4 / hertz * 1000)) / 1000
        loop = blocked_arm_loop(t, triangular_torque(t, 8.0, hertz), stiffness=800.0, damping=2.0, coulomb=0.4)
        out.append(str(written(tmp_path / f"{name}.csv", ("pin",), t, loop.position, loop.torque)))
    return out


def test_stiffness_of_a_held_arm_is_that_of_the_recordings(held, robots, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), *held, "--out", str(out)]) == 0
    (one,) = results(out)
    parameters = {name: entry["value"] for name, entry in one["parameters"].items()}
    assert one["joint"] == "pin"
    assert parameters["stiffness"] == pytest.approx(800.0, rel=0.01)
    assert parameters["damping"] == pytest.approx(2.0, rel=0.1)
    assert parameters["dry friction"] == pytest.approx(0.4, rel=0.05)
    assert matplotlib.image.imread(out / "stiffness.png")[..., :3].min() < 0.5
    assert "note" not in capsys.readouterr().out


def test_one_loop_is_said_to_separate_damping_from_friction_hardly(held, robots, capsys):
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), held[0]]) == 0
    assert "note: one recording hardly separates damping from dry friction" in capsys.readouterr().out


def test_a_stiffness_below_zero_is_said_to_be_none(held, robots, tmp_path, capsys):
    # Known truth: the torque of the loops with the wrong sign.
    loop = np.loadtxt(held[0], delimiter=",", skiprows=1)
    loop[:, -1] *= -1
    file = written(tmp_path / "flipped.csv", ("pin",), loop[:, 0], loop[:, 1:2], loop[:, 2:3])
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), str(file)]) == 0
    assert "note: no transmission has a stiffness below zero" in capsys.readouterr().out.replace("\n", " ")


def test_a_joint_that_the_robot_lacks_is_refused(held, robots, capsys):
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), held[0], "--joint", "knee"]) == 2
    assert "--joint names the unknown joint 'knee'" in capsys.readouterr().err


@pytest.fixture
def three_tests(tmp_path, rng):
    """The three tests of the CEA branch, with 0.01 N m s/rad and 0.03 N m in its passive joints."""
    robot, out = load_robot("cea_branch"), []
    for test in ("t1", "t2", "t3"):
        motion = friction_test_motion(test)
        tau = inverse_dynamics(robot, motion)
        more = loop_friction(
            motion.v[:, 1],
            motion.v[:, 2],
            arm=Friction(0.02, 0.05),
            forearm=Friction(0.03, 0.06),
            passive=Friction(0.01, 0.03),
        )
        tau = tau + np.column_stack([np.zeros(len(tau)), *more]) + 1e-3 * rng.standard_normal(tau.shape)
        out.append(str(written(tmp_path / f"{test}.csv", robot.joint_names, motion.t, motion.q, tau)))
    return out


def test_three_tests_give_the_friction_of_the_passive_joints(three_tests, tmp_path):
    out = tmp_path / "out"
    assert main(["experiment", "friction", "cea_branch", *three_tests, "--out", str(out)]) == 0
    passive = results(out)[-1]
    assert passive["joint"] == "passive joints"
    for name, truth in (("viscous", 0.01), ("coulomb", 0.03)):
        found = passive["parameters"][name]
        assert abs(found["value"] - truth) < max(4 * found["std"], 0.1 * truth)


def test_a_test_of_the_three_that_is_missing_is_named(three_tests, capsys):
    assert main(["experiment", "friction", "cea_branch", *three_tests[:2]]) == 2
    assert "The recordings lack test t3" in capsys.readouterr().err
