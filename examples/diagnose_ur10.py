"""What the URDF of a UR10 lacks beside the real arm: a ROS 2 bag of 27.5 s, torques from motor currents."""

from __future__ import annotations

import sys
from pathlib import Path

from identification.data import datasets
from identification.data.reading import read_recording
from identification.pipeline import diagnose
from identification.reporting.diagnosis_summary import summary
from phantom_dyn import load_robot
from phantom_dyn.errors import PhantomDynError

CONFIG = Path(__file__).parent / "data" / "ur10" / "robot.yaml"


def main() -> None:
    robot = load_robot("example:ur10", config=CONFIG)
    bag = datasets.fetch("ur10_unisa") / "ur10_exciting_trajectory.db3"
    print(summary(diagnose(robot, (read_recording(bag, robot),))))


if __name__ == "__main__":
    try:
        main()
    except PhantomDynError as error:  # no robot models, no recording
        sys.exit(str(error))
