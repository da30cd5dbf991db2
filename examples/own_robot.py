"""The Python interface in a few lines: ``python examples/own_robot.py robot.urdf log.csv``."""

from __future__ import annotations

import sys

import phantom_dyn as dyn


def main(robot_file: str, log_file: str) -> None:
    diagnosis = dyn.diagnose(robot_file, log_file)
    print(diagnosis)
    for finding in diagnosis.findings:
        print(finding.effect, finding.joint, finding.share, finding.parameters)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("own_robot.py takes a robot file and a log: python examples/own_robot.py robot.urdf log.csv")
    try:
        main(*sys.argv[1:])
    except dyn.PhantomDynError as error:
        sys.exit(str(error))
