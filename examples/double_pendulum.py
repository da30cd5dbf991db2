"""The double pendulum C.1 against two models of it: one without friction, and one with inertias that are wrong.

The second is the file that its makers identified: it counts m r^2 of both links twice, and it holds their friction.
"""

from __future__ import annotations

import sys
from pathlib import Path

from arguments import chosen_folder
from double_pendulum_logs import write_double_pendulum_logs

from identification.data import datasets
from identification.data.reading import read_recording
from identification.pipeline import diagnose
from identification.reporting.diagnosis_summary import summary
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError

CONFIG = Path(__file__).parent / "data" / "double_pendulum" / "robot.yaml"
MODELS = ("C1_model.urdf", "design_C1_identified.urdf")


def main(folder: Path) -> None:
    logs = write_double_pendulum_logs(folder)
    for model in MODELS:
        robot = load_robot(datasets.fetch("dfki_double_pendulum") / model, config=CONFIG)
        print(f"== {model}\n{summary(diagnose(robot, tuple(read_recording(log, robot) for log in logs)))}\n")


if __name__ == "__main__":
    try:
        main(chosen_folder(__doc__, "double_pendulum"))
    except LogError as error:
        sys.exit(str(error))
