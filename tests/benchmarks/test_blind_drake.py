"""Robots of the second make. Oracles: a pendulum by hand, conservation of energy, Drake's own inverse dynamics."""

import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.gapbench.makes.drake.engine import installed

if not installed():
    pytest.skip("Drake is not installed: 'make drake' puts it into .venv-drake", allow_module_level=True)

from benchmarks.blind.generate import FILES, case_ids, draw
from benchmarks.gapbench.makes.drake import sizing
from benchmarks.gapbench.makes.drake.case import draw_case
from benchmarks.gapbench.makes.drake.contacts import Fine
from benchmarks.gapbench.makes.drake.departures import none
from benchmarks.gapbench.makes.drake.measure import lag_of_loops, on_even_clock, residual, rms, ruler
from benchmarks.gapbench.makes.drake.motions import Motion
from benchmarks.gapbench.makes.drake.plant import Plant
from benchmarks.gapbench.makes.drake.robots import KINDS, Part, Robot, drawn_robot
from benchmarks.gapbench.makes.drake.session import Setup, drawn_setup, with_fine
from benchmarks.gapbench.makes.drake.simulate import STEP, Run, Session, simulated
from benchmarks.gapbench.scoring.judged import judged

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


def test_a_mass_that_is_carried_beside_a_payload_weighs_as_well():
    """m g r sin q of each of the two, at rest."""
    loaded = replace(PENDULUM, payload=(1.0, (0.0, 0.0, -0.2)), carried=(0.5, (0.0, 0.0, -0.4)))
    q, still = np.array([[0.7]]), np.zeros((1, 1))
    more = Plant(loaded).torque(q, still, still) - Plant(PENDULUM).torque(q, still, still)
    assert more[0, 0] == pytest.approx(9.81 * (1.0 * 0.2 + 0.5 * 0.4) * np.sin(0.7), rel=1e-9)


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
    less = np.full(len(setup.given.parts), 1e-3)
    setup = with_fine(setup, less, less)
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


def test_a_current_loop_follows_a_ramp_by_its_time_constant():
    """A first-order lag is behind a ramp by slope times time constant; the held ramp by half a tick less."""
    t, slope, time = np.arange(0.0, 1.0, 1e-3), 40.0, 5e-3
    ramp = slope * t[:, None]
    run = Run(t, ramp, ramp, ramp, ramp, ramp)
    late = lag_of_loops(run, np.array([time]))[200:-1, 0]
    assert late == pytest.approx(slope * time, rel=1e-2)


@pytest.mark.parametrize(("beyond", "drawn"), [((5.0, 5.0), True), ((5.0, 1.5), False), ((1.5, 5.0), False)])
def test_a_pair_is_drawn_only_if_each_effect_is_beyond_the_tolerance(monkeypatch, beyond, drawn):
    # By hand: each changes 3.5 floors, of which the tolerance has to leave half.
    one, two = np.zeros((400, 1)), np.zeros((400, 1))
    one[::2], two[1::2] = 5.0, 5.0
    left = iter(beyond)
    alone = iter([(1.0, None, one), (1.0, None, two)])
    monkeypatch.setattr(sizing, "drawn_effect", lambda rng, name, measure: name)
    monkeypatch.setattr(sizing, "_sought", lambda effect, wanted, measure: next(alone))
    monkeypatch.setattr(sizing, "run_with", lambda setup, changes: "both")
    monkeypatch.setattr(sizing, "tolerance_columns", lambda shop: None)
    monkeypatch.setattr(sizing, "beyond_tolerance", lambda change, shop, columns: next(left))
    measure = SimpleNamespace(setup=None, change=lambda run: one + two)
    assert (sizing.drawn_pair(np.random.default_rng(0), 0, measure, None) is not None) == drawn


def test_a_case_is_the_same_again_and_the_scorer_reads_it(tmp_path):
    first = draw_case(0, "null")
    name = draw(0, "null", tmp_path / "cases", tmp_path / "answers", "drake")
    assert [name] == case_ids([("null", range(1))], "drake") == [first.id]
    assert sorted(p.name for p in (tmp_path / "cases" / name).iterdir()) == sorted(FILES)
    answer = json.loads((tmp_path / "answers" / f"{name}.json").read_text())
    assert answer == json.loads(json.dumps(first.answer))
    said = {"verdict": "no_gap", "findings": [], "joints": []}
    assert not judged(answer, {"diagnosis": said, "seconds": 1.0}).false_claim
    # What bristles and current loops of this null leave is less than half a floor, the loops' part less than a tenth.
    assert max(answer["fine"]) < 0.5
    assert max(answer["loop"]) < 0.1


def test_a_motion_that_has_run_away_is_said_before_drake_ends_the_process():
    # Oracle: the exception that all draws of this make take for an impossible case.
    robot = drawn_robot(np.random.default_rng(1), "arm2")
    with pytest.raises(FloatingPointError, match="run away"):
        Plant(robot).equation(np.full(2, np.nan), np.zeros(2))
