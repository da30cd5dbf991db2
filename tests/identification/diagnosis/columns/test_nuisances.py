import numpy as np
import pytest

from identification.diagnosis.columns.nuisances import moves_of, touching
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion


@pytest.fixture(scope="module")
def arm():
    return load_robot("example:ur10")


def test_a_move_of_a_body_touches_the_joints_whose_torque_depends_on_it(arm, rng):
    # Oracle: Pinocchio's regressor at random states, which is zero where a body is not behind a joint.
    q, v, a = rng.normal(size=(3, 20, arm.nv))
    columns = rigid_body_regressor(arm, Motion(np.linspace(0.0, 1.0, 20), q, v, a))
    moves, rows = moves_of(arm), touching(arm, moves_of(arm))
    bodies = {k: move.place for k, move in enumerate(moves) if isinstance(move.place, int)}
    assert len(bodies) > arm.nv
    for k, body in bodies.items():
        first = 10 * (body - 1)
        felt = np.abs(columns[:, :, first : first + 10]).max(axis=(0, 2)) > 0
        assert [k in row for row in rows] == felt.tolist()


def test_a_shift_of_all_torques_in_time_touches_every_joint(arm):
    moves = moves_of(arm)
    assert moves[-1].kind == "timing"
    assert all(row[-1] == len(moves) - 1 for row in touching(arm, moves))
