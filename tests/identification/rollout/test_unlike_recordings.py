"""Rollouts of recordings that differ, and of one that runs into a stop: truths are known from simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.changes import Change, KnownPayload, robot_in
from identification.data.recording import Recording
from identification.notes import Code
from identification.pipeline import diagnose
from identification.words.note_words import sentence
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Controller
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate

# Whole diagnoses: what they call is checked beside the functions.
pytestmark = pytest.mark.whole

RUBS = Cause(effect_named("coulomb_friction"), "pin", np.array([1.0]))


@pytest.fixture(scope="module")
def two_loads(pendulum, record):
    """Diagnosis of a pendulum that rubs, without and with 1.5 kg, under two controllers."""
    gains = ((300.0, 30.0), (120.0, 12.0))
    first, second = ({"pin": Controller("pd", *pair)} for pair in gains)
    changes = (
        Change("a.csv", controllers=first),
        Change("b.csv", KnownPayload(1.5, (0.0, 0.0, -0.9)), controllers=second),
    )
    robots = [robot_in(pendulum, change) for change in changes]
    recordings = tuple(
        replace(record(robot, RUBS, kp=kp, kd=kd).recording, file=change.file)
        for robot, (kp, kd), change in zip(robots, gains, changes, strict=True)
    )
    return diagnose(pendulum, recordings, changes=changes)


def test_each_recording_is_simulated_with_the_load_that_it_carried(two_loads):
    # Without its 1.5 kg the second one would be 30 times as far off.
    apart = {entry["recording"]: entry for entry in two_loads.rollout["recordings"]}
    assert list(apart) == ["a.csv", "b.csv"]
    for entry in apart.values():
        assert entry["rms_after"]["pin"] < 2e-3
        assert entry["rms_after"]["pin"] < 0.2 * entry["rms_before"]["pin"]


def test_the_error_of_all_is_the_mean_square_of_that_of_each(two_loads):
    whole = two_loads.rollout["rms_before"]["pin"]
    parts = [entry["rms_before"]["pin"] for entry in two_loads.rollout["recordings"]]
    assert min(parts) < whole < max(parts)


def test_each_recording_is_simulated_under_its_own_controller(two_loads):
    (said,) = (sentence(note) for note in two_loads.notes if note.code is Code.CLOSED_LOOP)
    before, after = (float(said.split(" by ")[k].split()[0]) for k in (1, 2))
    assert after < 0.2 * before


def test_one_recording_is_not_told_apart(pendulum, record):
    rollout = record(pendulum, RUBS).rollout(RUBS)
    assert "recordings" not in rollout.json


def test_a_recording_that_runs_into_a_stop_of_the_model_says_where_and_when(pendulum, ready):
    # Truth: a stop at 0.5 rad, which the drive runs into where its reference goes to 0.7 rad.
    model = pendulum.model.copy()
    model.upperPositionLimit = np.array([0.5])
    robot = replace(pendulum, model=model)
    t = np.arange(2000) / 200.0
    q_ref = (0.1 + 0.6 * np.sin(2.4 * t) + 0.05 * np.sin(7.0 * t))[:, None]
    law = position_control(t, q_ref, np.gradient(q_ref, t, axis=0), kp=np.array([80.0]), kd=np.array([8.0]))

    def held(time, q, v):
        return law(time, q, v) - np.where(q > 0.5, 2e4 * (q - 0.5) + 200.0 * v, 0.0)

    moved = simulate(robot, (), held, t, q_ref[0])
    rng = np.random.default_rng(4)
    asked = np.array([law(*row) for row in zip(t, moved.q, moved.links.v, strict=True)])
    q = moved.q + 1e-5 * rng.standard_normal(q_ref.shape)
    tau = asked + 0.01 * rng.standard_normal(q_ref.shape)
    recording = Recording("stop.csv", robot.joint_names, t, q, tau)
    found = ready(robot, recording, moved).rollout()
    assert found.json is not None
    (one,) = (one for one in found.json["limits_engaged"] if one["model"] == "given")
    assert (one["joint"], one["recording"], one["limit"]) == ("pin", "stop.csv", 0.5)
    pressed = t[moved.q[:, 0] > 0.4999]
    assert np.abs(pressed - one["t"]).min() < 0.5
    assert "pin runs past the limit of 0.5 rad" in sentence(found.warnings[0])
