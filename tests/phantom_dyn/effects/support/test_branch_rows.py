"""Which joints feel where a joint is. Oracle: Pinocchio's derivatives of the inverse dynamics."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn import load_robot
from phantom_dyn.effects.support.rows import branch_rows
from phantom_dyn.model.robot_files import examples_folder, find_example


@pytest.fixture(scope="module")
def humanoid(tmp_path_factory):
    # Without the fingers that follow others: in a closed chain all rows may depend on any joint.
    text = find_example("talos_data/talos_reduced", examples_folder()).read_text()
    file = tmp_path_factory.mktemp("humanoid") / "talos.urdf"
    file.write_text(re.sub(r"<mimic [^>]*/>", "", text))
    return load_robot(file)


@pytest.mark.parametrize("joint", ["leg_left_1_joint", "leg_right_6_joint", "torso_2_joint", "arm_left_4_joint"])
def test_only_joints_before_and_behind_a_joint_feel_where_it_is(humanoid, joint, rng):
    model = humanoid.model.copy()
    data = model.createData()
    by_position, *_ = pin.computeRNEADerivatives(
        model, data, pin.randomConfiguration(model), rng.normal(size=model.nv), rng.normal(size=model.nv)
    )
    column = np.abs(by_position[:, humanoid.joint_names.index(joint)])
    felt = set(np.flatnonzero(column > 1e-9 * column.max()).tolist())
    assert felt <= set(branch_rows(humanoid, joint))
    assert len(branch_rows(humanoid, joint)) < humanoid.nv


def test_in_a_closed_chain_all_joints_feel_it():
    phantom = load_robot("phantom_1_5")
    assert branch_rows(phantom, phantom.joint_names[0]) == (0, 1, 2)


def test_in_a_serial_arm_all_joints_feel_it(planar):
    assert branch_rows(planar, "elbow") == (0, 1)
