"""What a recording determines of each body.

Oracle: the null space of the regressor by singular values. A parameter is identifiable alone if no null vector has an
entry there, not at all if its column is zero.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from identification.identify.hold_out import split_logs
from identification.identify.identifiability import (
    body_table,
    excited_base,
    identified_shares,
    not_excited,
    regrouped_into,
    unidentified,
)
from identification.identify.identified_model import JointTerms, effects_of, without_estimated
from identification.regression.base_parameters import base_parameters, base_parameters_of_matrix
from identification.regression.regressor import torque_regressor
from phantom_dyn.model.loading import load_robot


def shares_by_null_space(W):
    norms = np.linalg.norm(W, axis=0)
    scaled = W / np.where(norms > 1e-9 * norms.max(), norms, 1.0)
    _, sizes, rows = np.linalg.svd(scaled)
    rank = int(np.sum(sizes > 1e-8 * sizes[0]))
    free = np.abs(rows[rank:]).max(axis=0, initial=0.0) < 1e-7
    zero = norms <= 1e-9 * norms.max()
    return tuple("none" if z else "alone" if f else "combination" for z, f in zip(zero, free, strict=True))


@pytest.mark.parametrize("name", ["pendulum.urdf", "planar2.urdf", "arm3.urdf", "fourbar.xml", "parallelogram.urdf"])
def test_shares_are_those_of_the_null_space(name, robots, recorded):
    robot = load_robot(robots / name)
    logs = split_logs(robot, (recorded(robot, seconds=6.0),)).train
    regressor = torque_regressor(robot, logs, ())
    base = base_parameters(regressor)
    stacked = np.concatenate([block.reshape(-1, block.shape[2]) for block in regressor.blocks()])
    assert identified_shares(base) == shares_by_null_space(stacked)


def test_of_a_pendulum_two_first_moments_and_one_inertia_are_seen(robots, recorded):
    # Closed form: the torque of a pendulum about y under gravity along z depends on m x, m z and Iyy.
    robot = load_robot(robots / "pendulum.urdf")
    log = split_logs(robot, (recorded(robot),)).train[0]
    base = base_parameters(torque_regressor(robot, log, ()))
    body = body_table(robot, base, base)[0]
    assert {name for name, share in body.this_recording.items() if share == "alone"} == {"mx", "mz", "Iyy"}
    assert {share for name, share in body.this_recording.items() if name not in ("mx", "mz", "Iyy")} == {"none"}


def test_a_dependent_parameter_is_part_of_those_it_regroups_into():
    # c = 2 a + b, and d is zero.
    W = np.random.default_rng(0).standard_normal((9, 2))
    base = base_parameters_of_matrix(np.column_stack([W, W @ [2.0, 1.0], np.zeros(9)]), "abcd")
    assert regrouped_into(base) == {2: ("aR", "bR"), 3: ()}
    assert identified_shares(base) == ("combination", "combination", "combination", "none")


@pytest.fixture(scope="module")
def bases(arm, recorded):
    """Base parameters of a recording in which tilt does not move, and of exciting motion."""
    robot = without_estimated(arm, JointTerms())
    effects = effects_of(arm, JointTerms())
    log = split_logs(arm, (recorded(arm, still=("tilt",)),)).train[0]
    return base_parameters(torque_regressor(robot, log, effects)), excited_base(robot, log, effects)


def test_what_a_recording_lacks_is_what_other_motion_could_part(bases):
    lacking = not_excited(*bases)
    assert "tilt.coulomb_friction.torque" in lacking
    assert not any(name.startswith("slide.") for name in lacking)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("column.m", "no motion of this robot makes it produce torque"),
        ("tilt.viscous_friction.coefficient", "it produces no torque in this recording"),
        ("beam.Ixz", "in this recording it is only seen within .*; another motion can separate them"),
        ("beam.Izz", "in every motion of this robot it is only seen within"),
    ],
)
def test_the_reason_is_the_robot_or_the_recording(bases, name, why):
    reasons = {entry.name: entry.why for entry in unidentified(*bases)}
    assert re.match(why, reasons[name])


def test_random_motion_excites_all_that_a_rich_recording_does(arm, recorded):
    effects = effects_of(arm, JointTerms())
    robot = without_estimated(arm, JointTerms())
    log = split_logs(arm, (recorded(arm),)).train[0]
    assert base_parameters(torque_regressor(robot, log, effects)).rank == excited_base(robot, log, effects).rank
