"""What a model without friction lacks on the EMPS axis, beside what the authors of the recording publish."""

from __future__ import annotations

import sys
from pathlib import Path

from arguments import chosen_folder
from emps_log import PUBLISHED, write_emps_log

from identification.data.reading import read_recording
from identification.pipeline import diagnose
from identification.reporting.diagnosis_summary import summary
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError


def main(folder: Path) -> None:
    robot = load_robot("emps")
    diagnosis = diagnose(robot, (read_recording(write_emps_log(folder), robot),))
    print(summary(diagnosis))
    print("\nbeside the published values")
    for finding in diagnosis.findings:
        for name, found in finding.parameters.items():
            published = PUBLISHED.get((finding.effect, name))
            beside = "not published" if published is None else f"{published:9.4f}"
            print(f"  {name:<22} {found.value:9.4f} +- {found.std:7.4f} {found.unit:<7}  {beside}")


if __name__ == "__main__":
    try:
        main(chosen_folder(__doc__, "emps"))
    except LogError as error:
        sys.exit(str(error))
