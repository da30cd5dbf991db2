"""Rollouts of legs that swing on a base that moves as it was measured.

Oracles: known truth, on torques that Pinocchio computes for a free-flyer; and by hand.
"""

from dataclasses import replace

import numpy as np
import pytest

from floating_leg import log_of_leg, written_leg
from identification.data.floating.base_errors import base_without_errors, torque_of_base_errors
from identification.data.log import Band, Log
from identification.data.reading import recording
from identification.data.recording import Table
from identification.diagnosis.evidence import Evidence
from identification.engine.products.blocks import Block
from identification.rollout.compare import Errors, Rollout, WindowMotion
from identification.rollout.followed import with_followed
from identification.rollout.rollout_starts import Window, spread, windows_in
from identification.rollout.shots import under_torque
from identification.rollout.simulated_models import model_of
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.simulate import Cause

DRY = Cause(effect_named("coulomb_friction"), "knee", np.array([0.3]))


@pytest.fixture(scope="module")
def stepping(tmp_path_factory, ready):
    """A leg with more friction at its knee than its model has, whose foot stands half of the time."""
    file = written_leg(tmp_path_factory.mktemp("leg"))
    robot = load_robot(file)
    columns = log_of_leg(file, np.random.default_rng(5), dry=0.3, steps=True)
    return ready(robot, recording(Table("log.csv", columns), robot), None)


def test_a_model_with_its_friction_follows_the_swings_and_the_given_one_does_not(stepping):
    found = stepping.rollout(DRY)
    assert found.rms_after["knee"] < 0.1 * found.rms_before["knee"]
    assert found.rms_after["knee"] < 0.01


def test_a_base_that_were_bolted_down_would_take_the_leg_elsewhere(stepping):
    on_base = stepping.rollout(DRY)
    log = stepping.log
    level = replace(
        log.motion.base,
        w=0 * log.motion.base.w,
        dw=0 * log.motion.base.dw,
        f=np.tile([0.0, 0.0, 9.81], (len(log.tau), 1)),
    )
    held = replace(stepping, log=replace(log, motion=replace(log.motion, base=level))).rollout(DRY)
    assert held.rms_after["knee"] > 10 * on_base.rms_after["knee"]


def test_nothing_is_compared_while_the_foot_stands(stepping):
    shots = stepping.shots()
    assert len(shots) > 3
    assert not any(shot.log.touched[shot.window.start : shot.window.stop].any() for shot in shots)


def test_a_leg_is_led_along_the_recording_while_its_foot_stands(stepping):
    # Some 20 N m of the ground are in the measured torque.
    log, model = stepping.log, model_of(stepping.robot, ())
    first = int(np.flatnonzero(log.touched[1:, 0] & ~log.touched[:-1, 0])[3]) + 1
    shot = replace(stepping.shots()[0], window=Window(0, first, first + 250, -1, 0))
    off = [
        np.abs(under_torque(one, model, log.tau) - shot.read).max()
        for one in (shot, replace(shot, log=replace(log, touched=None)))
    ]
    assert log.touched[first : first + 250].all()
    assert off[0] < 0.3 < 10.0 < off[1]


def test_stiff_controllers_hold_both_models_near_their_references(stepping):
    actuators = tuple(replace(a, controller=Controller(kp=100.0, kd=1.0)) for a in stepping.robot.actuators)
    log = replace(stepping.log, q_ref=stepping.log.motion.q)
    stiff = replace(stepping, robot=replace(stepping.robot, actuators=actuators), log=log)
    found = stiff.rollout(controlled=True)
    assert max(found.rms_after.values()) < 0.05


def test_without_the_errors_of_its_sensors_the_base_needs_their_spurious_torque_less(stepping):
    robot, log = stepping.robot, stepping.log
    sizes = (("accelerometer offset x", 2e-4), ("gyroscope scale y", 1e-5), ("place of the accelerometer z", 1e-5))
    base = base_without_errors(robot, log, slice(None), sizes)
    more = inverse_dynamics(robot, replace(log.motion, base=base)) - inverse_dynamics(robot, log.motion)
    np.testing.assert_allclose(more, torque_of_base_errors(robot, log, sizes), rtol=0, atol=1e-9)


def legs(*touched: np.ndarray) -> Log:
    """A second at 100 Hz of legs of one joint each."""
    t, none = np.arange(100) / 100.0, np.zeros((100, len(touched)))
    names = tuple(f"j{k}" for k in range(len(touched)))
    band = Band(100.0, 10.0, np.ones(1), 1)
    log = Log("a.csv", names, Motion(t, none, none, none), none, band, np.ones(100, dtype=bool))
    return replace(log, touched=np.column_stack(touched))


def at(*stretches: tuple[int, int]) -> np.ndarray:
    out = np.zeros(100, dtype=bool)
    for start, stop in stretches:
        out[start:stop] = True
    return out


def windows(log: Log, seconds: float = 0.5) -> list[tuple[tuple[int, ...] | None, int, int, int]]:
    blocks, one = (Block(0, 0, 100, 0),), np.zeros(1, np.int64)
    found = windows_in((log,), blocks, one, one, seconds=seconds, lead=0.2)
    return sorted((w.joints, w.start, w.stop, w.lead) for w in found)


def test_every_leg_has_windows_in_its_own_swings():
    left, right = at((0, 40), (70, 100)), at((30, 80))
    assert windows(legs(left, left, right)) == [((0, 1), 40, 70, 0), ((2,), 0, 30, 0), ((2,), 80, 100, 0)]


def test_long_swings_are_cut_and_what_was_free_before_leads_up_to_a_window():
    assert windows(legs(at((0, 20))), seconds=0.39) == [((0,), 20, 60, 0), ((0,), 60, 100, 20)]


def test_a_contact_that_flickers_leaves_no_swing():
    flickers = at((0, 30), (37, 60))
    assert windows(legs(flickers)) == [((0,), 60, 100, 0)]


def test_a_robot_that_hangs_has_windows_of_all_its_joints():
    assert windows(legs(at(), at()), seconds=0.49) == [(None, 0, 50, 0), (None, 50, 100, 20)]


def test_every_leg_has_as_many_windows():
    many = tuple(Window(0, k, k + 1, 0, 0, (leg,)) for leg in range(4) for k in range(20 + leg))
    chosen = spread(many, 12)
    assert [w.joints for w in chosen] == [(leg,) for leg in range(4) for _ in range(3)]
    assert [w.start for w in chosen[:3]] == [0, 10, 19] or [w.start for w in chosen[:3]] == [0, 9, 19]


def test_errors_are_those_of_the_joints_that_a_window_compares():
    # By hand: 3 and 4 in windows of the first joint, 5 of the second, none of the third.
    none = np.full(2, np.nan)
    series = (np.column_stack([[0.0, 3.0], none, none]), np.column_stack([[0.0, 4.0], none, none]),
              np.column_stack([none, [0.0, 5.0], none]))  # fmt: skip
    errors = Errors(3 * (np.array([0.0, 1.0]),), *(4 * (series,)))
    np.testing.assert_allclose(errors.rms(series, 1.0), [np.sqrt(12.5), 5.0, 0.0])
    np.testing.assert_array_equal(errors.compared, [True, True, False])


def test_swings_of_two_legs_at_once_are_both_drawn():
    log, none = legs(at(), at()), np.zeros((100, 2))
    evidence = Evidence(log.motion.t, none, none, none, none, none, none, ({}, {}))
    one, other = np.full((50, 2), np.nan), np.full((50, 2), np.nan)
    one[:, 0], other[:, 1] = 1.0, 2.0
    motions = (
        WindowMotion(Window(0, 20, 70, 0, 0, (0,)), one, one),
        WindowMotion(Window(0, 30, 80, 0, 0, (1,)), other, other),
    )
    followed = with_followed(evidence, Rollout(0.5, {}, {}, motions=motions), (log,)).followed
    assert np.flatnonzero(followed.before[:, 0] == 1.0).tolist() == list(range(21, 70))
    assert np.flatnonzero(followed.after[:, 1] == 2.0).tolist() == list(range(31, 80))
