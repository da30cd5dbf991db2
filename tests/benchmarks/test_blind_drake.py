"""Robots of the second make. Oracles: a pendulum by hand, conservation of energy, Drake's own inverse dynamics."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.blind.makes.drake.engine import installed

if not installed():
    pytest.skip("Drake is not installed: 'make drake' puts it into .venv-drake", allow_module_level=True)

from benchmarks.blind.generate import FILES, case_ids, draw
from benchmarks.blind.judged import judged
from benchmarks.blind.makes.drake.case import draw_case
from benchmarks.blind.makes.drake.contacts import Fine
from benchmarks.blind.makes.drake.departures import none
from benchmarks.blind.makes.drake.measure import on_even_clock, residual, rms, ruler
from benchmarks.blind.makes.drake.motions import Motion
from benchmarks.blind.makes.drake.plant import Plant
from benchmarks.blind.makes.drake.robots import KINDS, Part, Robot, drawn_robot
from benchmarks.blind.makes.drake.session import Setup, drawn_setup, with_fine
from benchmarks.blind.makes.drake.simulate import STEP, Run, Session, simulated

ROD = Part("hinge", False, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), 2.0, (0.0, 0.0, -0.3), (0.02, 0.03, 0.01), 1.0, 0.0, 2.0)
PENDULUM = Robot("pendulum_by_hand", (ROD,))


def _released(robot: Robot, start: np.ndarray, seconds: float) -> Run:
    """The robot without drive, friction and noise, released from rest."""
    t = np.arange(0.0, seconds, STEP)
    still = np.zeros((len(t), len(start)))
    motion, nothing = Motion(t, still + start, still, still), np.zeros(len(start))
    fine = Fine(nothing + 1.0, nothing, nothing + 1.0, nothing)
    return simulated(robot, none(len(start)), Session(motion, still, nothing, nothing, still, fine))


def test_a_pendulum_obeys_its_equation_of_motion():
    """(I + m c^2) a = torque - m g c sin q, against Drake's inverse dynamics."""
    q, v, a = (np.linspace(low, high, 9)[:, None] for low, high in ((-2, 3), (1, -4), (-5, 6)))
    by_hand = (0.03 + 2.0 * 0.3**2) * a + 2.0 * 9.81 * 0.3 * np.sin(q)
    assert Plant(PENDULUM).torque(q, v, a) == pytest.approx(by_hand, abs=1e-12)


def test_a_pendulum_swings_with_its_period():
    """Small swings: 2 pi sqrt((I + m c^2) / (m g c))."""
    run = _released(PENDULUM, np.array([0.02]), 6.0)
    q = run.motor[:, 0]
    down = np.flatnonzero((q[:-1] > 0.0) & (q[1:] <= 0.0))
    crossings = run.t[down] + STEP * q[down] / (q[down] - q[down + 1])
    period = 2.0 * np.pi * np.sqrt((0.03 + 2.0 * 0.09) / (2.0 * 9.81 * 0.3))
    assert np.diff(crossings) == pytest.approx(period, rel=2e-4)


@pytest.mark.parametrize("kind", ["arm2", "arm6"])
def test_a_robot_without_friction_keeps_its_energy(kind):
    robot = drawn_robot(np.random.default_rng(3), kind)
    run, plant = _released(robot, robot.array("home"), 1.0), Plant(robot)
    energy = np.array([plant.energy(q, v) for q, v in zip(run.motor[::50], run.speed[::50], strict=True)])
    turned_over = max(0.5 * v @ plant.equation(q, v)[0] @ v for q, v in zip(run.motor, run.speed, strict=True))
    assert np.ptp(energy) < 5e-3 * turned_over


@cache
def _moved(kind: str) -> tuple[Setup, Run]:
    """A robot without noise, without fine friction and without a current loop."""
    setup = drawn_setup(KINDS.index(kind), 0, 0)
    setup = with_fine(setup, np.full(len(setup.given.parts), 1e-3))
    setup = replace(setup, session=replace(setup.session, noise=0.0 * setup.session.noise))
    return setup, simulated(setup.truth, none(len(setup.truth.parts)), setup.session)


@pytest.mark.parametrize("kind", ["scara", "gantry"])
def test_the_logged_motion_satisfies_the_inverse_dynamics_of_drake(kind):
    """Without noise hardly anything is left below 20 Hz: reversals between two samples, and where a joint stops."""
    setup, run = _moved(kind)
    even = on_even_clock(run, setup.rate, setup.session.noise, run.motor)
    left = residual(setup.truth, Plant(setup.truth), even, setup.rate)
    assert (rms(left) < 0.01 * rms(even.torque)).all()


def test_an_offset_of_the_torque_is_found_at_its_size():
    """A constant below 20 Hz is itself: the paired difference is the offset over the floor, its sign turned."""
    setup = drawn_setup(0, 0, 0)
    measure = ruler(setup, simulated(setup.truth, none(2), setup.session))
    offset = 5.0 * float(measure.floor[1])
    change = measure.change(simulated(setup.truth, none(2).set("offset", 1, offset), setup.session))
    assert np.median(change[:, 1]) == pytest.approx(-5.0, rel=0.02)
    assert rms(change)[0] < 0.5


def test_a_case_is_the_same_again_and_the_scorer_reads_it(tmp_path):
    first = draw_case(0, "null")
    name = draw(0, "null", tmp_path / "cases", tmp_path / "answers", "drake")
    assert [name] == case_ids([("null", range(1))], "drake") == [first.id]
    assert sorted(p.name for p in (tmp_path / "cases" / name).iterdir()) == sorted(FILES)
    answer = json.loads((tmp_path / "answers" / f"{name}.json").read_text())
    assert answer == json.loads(json.dumps(first.answer))
    said = {"verdict": "no_gap", "findings": [], "joints": []}
    assert not judged(answer, {"diagnosis": said, "seconds": 1.0}).false_claim
    # What bristles and current loops of this null leave is less than half a floor, as is said of all.
    assert max(answer["fine"]) < 0.5
