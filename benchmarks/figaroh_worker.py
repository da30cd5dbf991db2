# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""FIGAROH's own `solve()` on one recording: runs in FIGAROH's environment, prints seconds and memory as JSON.

Called by `compare_figaroh.py`: ``figaroh_worker.py ROBOT.urdf RECORDING.npz CONFIG.yaml``.
"""

from __future__ import annotations

import contextlib
import io
import json
import resource
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
from figaroh.identification.base_identification import BaseIdentification


class Identification(BaseIdentification):
    """Reads what the other side reads, and takes it as it is: no filter, no decimation."""

    def load_trajectory_data(self, data_source=None):
        recording = np.load(self.recording)
        names = {"timestamps": "t", "positions": "q", "velocities": "v", "accelerations": "a", "torques": "tau"}
        return {theirs: recording[ours] for theirs, ours in names.items()}

    def filter_kinematics_data(self, filter_config=None):
        self.processed_data = {key: value for key, value in self.raw_data.items() if key != "torques"}


def peak_mb() -> float:
    """Largest memory that the process has held so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(urdf: str, recording: str, config: str) -> None:
    robot = pin.RobotWrapper(pin.buildModelFromUrdf(urdf))
    bare = peak_mb()
    result = {"regressor": np.inf, "solve": np.inf}
    for _ in range(2):
        one = Identification(robot, config)
        one.recording = Path(recording)
        one.identif_config.update(act_idxq=list(range(robot.nq)), act_idxv=list(range(robot.nv)))
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            start = time.process_time()
            one.initialize()
            middle = time.process_time()
            one.solve(decimate=False, plotting=False)
            end = time.process_time()
        result["regressor"] = min(result["regressor"], middle - start)
        result["solve"] = min(result["solve"], end - middle)
        result["first_peak_mb"] = result.get("first_peak_mb", peak_mb())
        result["parameters"] = len(one.phi_base)
        result["rms"] = float(one.rms_error)
        del one
    print(json.dumps({**result, "peak_mb": result["first_peak_mb"], "bare_mb": bare}))


if __name__ == "__main__":
    main(*sys.argv[1:])
