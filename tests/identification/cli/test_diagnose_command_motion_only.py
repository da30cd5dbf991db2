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


def test_a_log_of_positions_and_references_needs_no_option(log, capsys):
    code, out = diagnosed(log, CONTROLLER)
    said = capsys.readouterr()
    assert code == 0, said.err
    document, with_option = json.loads(out.read_text()), diagnosed(log, CONTROLLER, "--motion-only")[1]
    assert "positions and references only" in " ".join(document["data_warnings"])
    assert document["findings"] == json.loads(with_option.read_text())["findings"] != []


def test_gains_that_nobody_states_are_estimated(log, capsys):
    code, out = diagnosed(log, "joints: {pin: {}}\n")
    said = capsys.readouterr()
    assert code == 0, said.err
    document = json.loads(out.read_text())
    assert "No gains of pin are stated: kp = 60" in " ".join(document["data_warnings"])
    assert {"torque_constant", "viscous_friction"} <= {entry["effect"] for entry in document["not_testable"]}
    assert {finding["effect"] for finding in document["findings"]} <= {"coulomb_friction", "stribeck_friction"}


def test_a_log_of_positions_alone_is_refused_in_a_sentence(log, capsys):
    t, q, _ = np.loadtxt(log, delimiter=",", skiprows=1, unpack=True)
    np.savetxt(log, np.column_stack([t, q]), delimiter=",", header="t,q.pin", comments="")
    code, out = diagnosed(log, "joints: {pin: {}}\n")
    words = capsys.readouterr().err
    assert code == 2
    assert "log.csv has no torque: there is no column tau.pin" in words
    assert "or the references q_ref.<joint> of its position controllers" in words
    assert not out.exists()


def test_logs_with_and_without_torque_do_not_go_together(log, capsys):
    other = log.with_name("other.csv")
    t, q, q_ref = np.loadtxt(log, delimiter=",", skiprows=1, unpack=True)
    table = np.column_stack([t, q, q_ref, np.cos(t)])
    np.savetxt(other, table, delimiter=",", header="t,q.pin,q_ref.pin,tau.pin", comments="")
    code, _ = diagnosed(log, CONTROLLER, "--hold-out", str(other))
    assert code == 2
    assert "other.csv has one: diagnose them apart" in capsys.readouterr().err


def test_the_option_does_not_go_with_each(log, capsys):
    code, _ = diagnosed(log, CONTROLLER, "--motion-only", "--each")
    assert code == 2
    assert "--motion-only does not go with --each" in capsys.readouterr().err


def test_each_diagnoses_logs_without_torque_too(log, capsys):
    config = log.with_name("robot.yaml")
    config.write_text("joints: {pin: {}}\n")
    code = main(["diagnose", str(PENDULUM), str(log), "--robot-config", str(config), "--each", "--jobs", "1"])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "friction" in said.out
