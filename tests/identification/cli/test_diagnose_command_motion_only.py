"""The option ``--motion-only`` of the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from identification.cli.main import main
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate
from places import ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"
CONTROLLER = "joints: {pin: {controller: {kind: pd, kp: 60, kd: 6}}}\n"


@pytest.fixture
def log(tmp_path) -> Path:
    """12 s of positions and references of a pendulum that rubs more than its model."""
    robot, t = load_robot(PENDULUM), np.arange(2400) / 200.0
    q_ref = (0.6 * np.sin(1.3 * t) + 0.3 * np.sin(5.1 * t + 1.0))[:, None]
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=np.array([60.0]), kd=np.array([6.0]))
    rubs = Cause(effect_named("coulomb_friction"), "pin", np.array([1.0]))
    q = simulate(robot, (rubs,), law, t, np.zeros(1)).q + 1e-5 * np.random.default_rng(2).standard_normal((2400, 1))
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([t, q, q_ref]), delimiter=",", header="t,q.pin,q_ref.pin", comments=""
    )
    return tmp_path / "log.csv"


def diagnosed(log: Path, controller: str, *more: str) -> tuple[int, Path]:
    config, out = log.with_name("robot.yaml"), log.with_name("diagnosis.json")
    config.write_text(controller)
    return main(["diagnose", str(PENDULUM), str(log), "--robot-config", str(config), "--json", str(out), *more]), out


def test_positions_and_references_are_enough(log, capsys):
    code, out = diagnosed(log, CONTROLLER, "--motion-only")
    assert code == 0, capsys.readouterr().err
    document = json.loads(out.read_text())
    assert {finding["joint"] for finding in document["findings"]} == {"pin"}
    assert document["rollout"]["rms_after"]["pin"] < document["rollout"]["rms_before"]["pin"]
    assert "torque_constant" in {entry["effect"] for entry in document["not_testable"]}


def test_without_a_gain_the_command_says_what_is_needed(log, capsys):
    code, out = diagnosed(log, "joints: {pin: {}}\n", "--motion-only")
    assert code == 2
    assert "states no controller with a gain kp of pin: --motion-only needs it" in capsys.readouterr().err
    assert not out.exists()


def test_without_the_option_a_log_without_torque_is_refused(log, capsys):
    code, _ = diagnosed(log, CONTROLLER)
    assert code == 2
    assert "no torque" in capsys.readouterr().err


def test_the_option_does_not_go_with_each(log, capsys):
    code, _ = diagnosed(log, CONTROLLER, "--motion-only", "--each")
    assert code == 2
    assert "--motion-only does not go with --each" in capsys.readouterr().err
