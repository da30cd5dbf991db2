"""Which inertial parameters of a UR10 any recording can tell apart, and what the others regroup into."""

from __future__ import annotations

import sys

import numpy as np

from identification.regression.base_parameters import base_parameters_of_matrix
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.errors import RobotError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.motion import Motion


def main() -> None:
    robot = load_robot("example:ur10")
    rng = np.random.default_rng(1)
    q, v, a = rng.uniform(-2.0, 2.0, (3, 500, robot.nv))  # any motion that excites every joint gives the same columns
    W = rigid_body_regressor(robot, Motion(np.arange(500.0), q, v, a))
    base = base_parameters_of_matrix(W.reshape(-1, W.shape[2]), parameter_names(robot), parameter_units(robot))
    print(f"{robot.name}: {base.rank} base parameters of {len(base.names)}, condition {base.condition:.3g}")
    print(f"{len(base.zero)} parameters never produce torque: {', '.join(base.names[k] for k in base.zero)}")
    for equation in base.regroupings():
        print("  " + equation)


if __name__ == "__main__":
    try:
        main()
    except RobotError as error:  # the robot models are an extra
        sys.exit(str(error))
