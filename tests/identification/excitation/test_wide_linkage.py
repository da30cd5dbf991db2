"""A five-bar whose drives may move much further and faster than its loop lets them: lying, with unequal arms."""

from __future__ import annotations

import numpy as np
import pytest

from identification.excitation.excite import Excitation, excite
from identification.excitation.excited_base import base_of
from identification.excitation.motion_shapes import FourierSeries
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import rigid_body_regressor

LINK = (
    '<link name="{name}"><inertial><origin xyz="{middle} 0 0"/><mass value="{mass}"/>'
    '<inertia ixx="1e-5" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at} 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3.2" upper="3.2" effort="2" velocity="25"/></joint>'
)
# Name, mass and length of each rod: two arms, and the forearms that meet in a pin.
RODS = (("arm_a", 0.3, 0.18), ("forearm_a", 0.2, 0.26), ("arm_b", 0.25, 0.2), ("forearm_b", 0.15, 0.24))
JOINTS = (
    ("drive_a", "revolute", "base", "arm_a", -0.08),
    ("elbow_a", "revolute", "arm_a", "forearm_a", 0.18),
    ("drive_b", "revolute", "base", "arm_b", 0.08),
    ("elbow_b", "revolute", "arm_b", "forearm_b", 0.2),
    ("fixed_a", "fixed", "forearm_a", "pin_a", 0.26),
    ("fixed_b", "fixed", "forearm_b", "pin_b", 0.24),
)
LOOP = (
    "loops:\n  - {kind: point, frame_a: pin_a, frame_b: pin_b, active: [drive_a, drive_b], "
    "start: {drive_a: 2.2, elbow_a: -1.1, drive_b: 0.9, elbow_b: 1.1}}\n"
)


@pytest.fixture(scope="module")
def designed(tmp_path_factory) -> Excitation:
    folder = tmp_path_factory.mktemp("linkage")
    links = [
        LINK.format(name=name, middle=length / 2, mass=mass, inertia=mass * length**2 / 12)
        for name, mass, length in RODS
    ]
    joints = [
        JOINT.format(name=name, kind=kind, parent=parent, child=child, at=at)
        for name, kind, parent, child, at in JOINTS
    ]
    bare = '<link name="base"/><link name="pin_a"/><link name="pin_b"/>'
    (folder / "linkage.urdf").write_text(f'<robot name="linkage">{bare}{"".join(links + joints)}</robot>')
    (folder / "robot.yaml").write_text(LOOP)
    return excite(load_robot(folder / "linkage.urdf"), FourierSeries(4.0, 3), starts=2, seed=2)


@pytest.mark.whole
def test_the_descent_goes_on_where_its_first_steps_tear_the_loop_open(designed):
    # The best of the random starts is what a descent that gives up ends with.
    assert designed.condition < 0.6 * designed.start


@pytest.mark.whole
def test_its_condition_is_that_of_the_normed_columns(designed):
    # Oracle: singular values by NumPy, at a rate that the design has not seen; the columns span all others.
    W = rigid_body_regressor(designed.robot, designed.motion(400.0))
    W = W.reshape(-1, W.shape[2])
    columns = W[:, base_of(designed.robot).columns]
    assert np.linalg.matrix_rank(columns, tol=1e-8) == np.linalg.matrix_rank(W, tol=1e-8) == designed.rank
    stated = np.linalg.cond(columns / np.linalg.norm(columns, axis=0))
    assert designed.condition == pytest.approx(stated, rel=0.05)
