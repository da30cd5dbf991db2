"""Writes the public EMPS recording as a log: ``python examples/emps_log.py [FOLDER]``, by default ``demo/emps``.

EMPS is a ball-screw axis: 24.8 s at 1 kHz. The public file is MATLAB's, and its ``vir`` is the controller's output in
volts (a note that travels with it says force): ``gtau`` = 35.1507 N/V makes the drive force of it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from arguments import chosen_folder
from scipy.io import loadmat

from identification.data import datasets
from phantom_dyn.errors import LogError

# Janot, Gautier and Brunot (2019), estimated from this recording. Our torque offset is the force that acts on the
# axis; theirs (-3.1648 N) is the force that the drive spends on it.
PUBLISHED = {
    ("viscous_friction", "coefficient"): 203.5034,
    ("coulomb_friction", "torque"): 20.3935,
    ("torque_offset", "torque"): 3.1648,
    ("direction_dependent_friction", "torque_positive"): 20.1440,
    ("direction_dependent_friction", "torque_negative"): 20.6277,
    ("direction_dependent_friction", "coefficient_positive"): 166.7061,
    ("direction_dependent_friction", "coefficient_negative"): 240.4236,
}


def write_emps_log(folder: Path) -> Path:
    """The log ``emps.csv`` in a folder, from the data folder, the cache or the public address.

    Raises:
        LogError: If the recording cannot be had; says how to get it.
    """
    public = loadmat(datasets.fetch("emps") / "DATA_EMPS.mat", squeeze_me=True)
    columns = np.column_stack([public["t"], public["qm"], public["gtau"] * public["vir"]])
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "emps.csv"
    np.savetxt(path, columns, fmt="%.10g", delimiter=",", header="t,q.axis,tau.axis", comments="")
    return path


if __name__ == "__main__":
    try:
        print(write_emps_log(chosen_folder(__doc__, "emps")))
    except LogError as error:
        sys.exit(str(error))
