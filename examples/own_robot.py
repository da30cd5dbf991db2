"""The Python interface in ten lines: ``python examples/own_robot.py robot.urdf log.csv``."""

from __future__ import annotations

import sys

from identification.data.reading import read_recording
from identification.pipeline import diagnose
from identification.reporting.diagnosis_summary import summary
from phantom_dyn import load_robot
from phantom_dyn.errors import PhantomDynError


def main(robot_file: str, log_file: str) -> None:
    robot = load_robot(robot_file)
    recording = read_recording(log_file, robot)
    diagnosis = diagnose(robot, (recording,))
    print(summary(diagnosis))
    for finding in diagnosis.findings:
        print(finding.effect, finding.joint, finding.share, finding.parameters)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("own_robot.py takes a robot file and a log: python examples/own_robot.py robot.urdf log.csv")
    try:
        main(*sys.argv[1:])
    except PhantomDynError as error:
        sys.exit(str(error))
