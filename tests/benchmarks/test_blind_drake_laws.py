"""Laws of the second make that need no Drake. Oracles: closed forms of the bristle law, of a lag and of a delay."""

import ast
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gapbench.makes.drake.bristles import Bristles, linear
from benchmarks.gapbench.makes.drake.departures import none
from benchmarks.gapbench.makes.drake.drive import CommandHistory, passed, sensed
from benchmarks.gapbench.makes.drake.effects import NAMES, turned
from benchmarks.gapbench.makes.drake.measure import held_mean, size_of
from benchmarks.gapbench.makes.drake.motions import trapezoid
from benchmarks.gapbench.makes.drake.sizing import COUPLES
from places import CHECKOUT

MAKE = CHECKOUT / "benchmarks" / "gapbench" / "makes" / "drake"
FORBIDDEN = ("identification", "phantom_dyn", "pinocchio", "mujoco", "benchmarks", "generator")


def _imported(tree: ast.AST) -> list[str]:
    names = [x.name for node in ast.walk(tree) if isinstance(node, ast.Import) for x in node.names]
    return names + [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]


def test_no_file_of_the_make_imports_what_is_tested_or_the_first_make():
    files = sorted(MAKE.glob("*.py"))
    taken = {name for file in files for name in _imported(ast.parse(file.read_text()))}
    assert len(files) > 10
    assert not [name for name in taken if name.startswith(FORBIDDEN)]


def _bristles(**other) -> Bristles:
    one = {
        "stiffness": np.array([2e4]),
        "damping": np.array([40.0]),
        "viscous": np.array([[0.3, 0.5]]),
        "coulomb": np.array([[1.5, 1.0]]),
        "static": np.array([0.8]),
        "stribeck": np.array([0.05]),
    }
    return Bristles(**(one | other))


def _dragged(of: Bristles, speeds: np.ndarray, step: float) -> np.ndarray:
    """Friction while the slip speed is prescribed: its value at the end of every step."""
    bend, before, out = np.zeros(1), speeds[:1], []
    for speed in speeds:
        slip = np.array([speed])
        law = linear(of, bend, before, step, of.level(before))
        out.append(law.offset + law.slope * slip)
        bend, before = law.next_bend(bend, slip), slip
    return np.concatenate(out)


@pytest.mark.parametrize("speed", [0.02, 0.6, -0.03, -1.0])
def test_held_speed_gives_the_friction_of_the_stribeck_curve(speed):
    side = 0 if speed > 0 else 1
    dry, wet = (1.5, 1.0)[side], (0.3, 0.5)[side]
    expected = np.sign(speed) * (dry + 0.8 * np.exp(-((speed / 0.05) ** 2))) + wet * speed
    assert _dragged(_bristles(), np.full(4000, speed), 5e-4)[-1] == pytest.approx(expected, rel=1e-9)


def test_a_small_displacement_from_rest_is_held_with_the_stiffness_of_the_bristles():
    speeds = np.concatenate([np.full(100, 1e-5), np.zeros(400)])  # 0.5 micrometre, a hundredth of the breakaway
    held = _dragged(_bristles(damping=np.zeros(1)), speeds, 5e-4)[-1]
    assert held == pytest.approx(2e4 * 5e-7, rel=0.01)


def test_a_bristle_turned_round_follows_the_hysteresis_curve_of_dahl():
    """After a reversal from sliding, F = -T (1 - 2 exp(-x s0 / T)): Dahl's curve."""
    of = _bristles(
        stiffness=np.array([1e3]), damping=np.zeros(1), viscous=np.zeros((1, 2)), coulomb=np.ones((1, 2)),
        static=np.zeros(1),
    )  # fmt: skip
    step, speed = 1e-5, 0.1
    slid = _dragged(of, np.concatenate([np.full(15000, speed), np.full(300, -speed)]), step)
    x = speed * step * np.arange(1, 301)
    assert slid[15000:] == pytest.approx(-(1.0 - 2.0 * np.exp(-x * 1e3)), abs=3e-3)


def test_a_lag_answers_a_step_with_an_exponential():
    state, wanted = np.zeros(1), np.ones(1)
    for _ in range(20):
        mean, state = passed(state, wanted, np.array([0.01]), 1e-3)
    assert state[0] == pytest.approx(1.0 - np.exp(-2.0), rel=1e-12)
    # Mean over the last step: one less the integral of exp(-t / 0.01) from 19 to 20 ms over 1 ms.
    assert mean[0] == pytest.approx(1.0 - 10.0 * (np.exp(-1.9) - np.exp(-2.0)), rel=1e-9)


def test_no_lag_passes_the_torque_on():
    assert passed(np.zeros(1), np.array([3.0]), np.zeros(1), 1e-3)[0] == pytest.approx(3.0, rel=1e-5)


def test_a_delay_of_a_part_of_a_tick_mixes_two_commands():
    history = CommandHistory(np.array([0.0, 1.0, 2.0]), 1)
    for k, command in enumerate((2.0, 6.0, 6.0)):
        history.hold(k, np.array([command]))
    # From 1.0 to 2.0, 0.25 earlier: a quarter of the first command and three of the second.
    assert history.mean(1.0, 2.0, np.array([0.25])) == pytest.approx([0.25 * 2.0 + 0.75 * 6.0])


def test_an_encoder_reads_offset_eccentricity_and_a_coarser_step():
    of = none(1).set("reading", (0, 0), 0.5).set("reading", (0, 1), 0.1).set("reading", (0, 3), 2.0)
    fine = sensed(of, np.array([0.3]), np.array([1e-9]))
    assert fine == pytest.approx([0.3 + 0.5 + 0.1 * np.sin(0.6)], abs=1e-8)
    assert sensed(of.set("reading", (0, 4), 0.25), np.array([0.3]), np.array([1e-9])) == pytest.approx([0.75])


def test_a_base_is_turned_as_the_contract_says():
    """exp([r]x) applied to gravity: about x by a right angle, down becomes plus y."""
    assert turned(np.array([0.0, 0.0, -9.81]), np.array([np.pi / 2, 0.0, 0.0])) == pytest.approx([0, 9.81, 0])


@pytest.mark.parametrize("distance", [0.9, -0.9, 0.05])
def test_a_move_ends_where_it_should_and_at_rest(distance):
    t = np.linspace(0.0, 4.0, 4001)
    q, v, a = trapezoid(t, distance, 0.8, 4.0)
    assert (q[-1], v[-1]) == pytest.approx((distance, 0.0), abs=1e-12)
    assert np.abs(v).max() == pytest.approx(min(0.8, np.sqrt(abs(distance) * 4.0)), rel=1e-2)
    assert np.gradient(q, t) == pytest.approx(v, abs=4e-3)  # the acceleration over one sample
    assert np.cumsum(a) * 1e-3 == pytest.approx(v, abs=1e-2)


def test_a_held_command_is_averaged_over_a_window():
    t, held = np.array([0.0, 1.0, 2.0, 3.0]), np.array([[0.0], [4.0], [8.0], [0.0]])
    assert held_mean(t, held, np.array([2.0]), 1.0) == pytest.approx(np.array([[6.0]]))


def test_a_gap_is_measured_over_the_joints_that_it_reaches():
    change = np.zeros((100, 3))
    change[:, 0], change[:, 1] = 3.0, 0.2
    assert size_of(change) == pytest.approx(3.0)


def test_every_effect_of_the_contract_is_drawn_and_pairs_are_of_these():
    assert len(NAMES) == 23
    assert {name for couple in COUPLES for name in couple} <= set(NAMES)


def test_departures_are_not_shared():
    first = none(2)
    assert replace(first).set("dry", (0, 0), 1.0).dry[0, 0] == 1.0
    assert first.dry[0, 0] == 0.0
