"""Writes the runs of the double pendulum C.1 as logs: ``python examples/double_pendulum_logs.py [FOLDER]``.

The recording holds ten runs in one NPZ, as ``<run>__t``, ``<run>__q`` and so on with both joints in one array. A log is
one run with one array per column.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from arguments import chosen_folder

from identification.data import datasets
from phantom_dyn.errors import LogError

JOINTS = ("Joint1", "Joint2")


def write_double_pendulum_logs(folder: Path) -> tuple[Path, ...]:
    """One NPZ a run in a folder, with the measured motor torques.

    Raises:
        LogError: If the recording cannot be had; says how to get it.
    """
    source = datasets.fetch("dfki_double_pendulum") / "C1_sysid.npz"
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    with np.load(source) as runs:
        for run in sorted({key.partition("__")[0] for key in runs}):
            columns = {"t": runs[f"{run}__t"]}
            for k, joint in enumerate(JOINTS):
                columns[f"q.{joint}"] = runs[f"{run}__q"][:, k]
                columns[f"tau.{joint}"] = runs[f"{run}__tau_meas"][:, k]
            paths.append(folder / f"{run}.npz")
            np.savez(paths[-1], **columns)
    return tuple(paths)


if __name__ == "__main__":
    try:
        for path in write_double_pendulum_logs(chosen_folder(__doc__, "double_pendulum")):
            print(path)
    except LogError as error:
        sys.exit(str(error))
