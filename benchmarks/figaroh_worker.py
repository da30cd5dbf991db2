# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Run FIGAROH's own `solve()` on one recording in FIGAROH's environment, and print seconds and memory as JSON.

Called by `compare_figaroh.py`: ``figaroh_worker.py ROBOT.urdf PACKAGES RECORDING.npz CONFIG.yaml``. Robot, regressor
and solution are those of FIGAROH's example of a UR10; samples are used without its filter.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
from pathlib import Path

import numpy as np
from figaroh.identification.base_identification import BaseIdentification
from figaroh.tools.robot import load_robot

FEW = 200
"""Samples of a first run that is not timed, so that late imports and compiling do not count."""


class Identification(BaseIdentification):
    """Read the same files as the other side, and use the samples without a filter and decimation."""

    def load_trajectory_data(self, data_source=None):
        recording = np.load(self.recording)
        names = {"timestamps": "t", "positions": "q", "velocities": "v", "accelerations": "a", "torques": "tau"}
        return {theirs: recording[ours] for theirs, ours in names.items()}

    def filter_kinematics_data(self, filter_config=None):
        self.processed_data = {key: value for key, value in self.raw_data.items() if key != "torques"}


def memory_mb(field: str) -> float:
    """VmRSS (now) or VmHWM (largest so far) of this process [MB]; unlike in rusage, without the parent's."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(field))


def identified(robot, recording: str, config: str, few: int | None = None) -> tuple[Identification, float, float]:
    """The identification, seconds from the file to the regressor, and seconds of `solve()`."""
    one = Identification(robot, config)
    one.recording = Path(recording)
    one.identif_config.update(act_idxq=list(range(robot.nq)), act_idxv=list(range(robot.nv)))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        start = time.process_time()
        one.initialize(truncate=None if few is None else (0, few))
        middle = time.process_time()
        one.solve(decimate=False, plotting=False)
        return one, middle - start, time.process_time() - middle


def main(urdf: str, packages: str, recording: str, config: str) -> None:
    robot = load_robot(urdf, package_dirs=packages, load_by_urdf=True)
    identified(robot, recording, config, FEW)
    bare = memory_mb("VmRSS")
    one, regressor, solve = identified(robot, recording, config)
    result = {"seconds": regressor + solve, "solve": solve, "rank": len(one.phi_base), "rms": float(one.rms_error)}
    print(json.dumps({**result, "peak_mb": memory_mb("VmHWM"), "bare_mb": bare}))


if __name__ == "__main__":
    main(*sys.argv[1:])
