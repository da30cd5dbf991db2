"""Names of the files that a diagnosis writes into the folder of its report."""

from __future__ import annotations

YAML, URDF, MJCF = "corrected.yaml", "corrected.urdf", "corrected.xml"
RANDOMISATION, FEEDFORWARD, TABLE = "randomisation.yaml", "feedforward.py", "feedforward.csv"
ISAAC, SIMULATORS = "isaac_lab.py", "simulators.yaml"
NAMES = (YAML, URDF, MJCF, RANDOMISATION, FEEDFORWARD, TABLE, ISAAC, SIMULATORS)
"""Files that a diagnosis usually writes."""

RESIDUAL, RESIDUAL_TABLE = "residual.py", "residual.csv"
OPTIONAL = (RESIDUAL, RESIDUAL_TABLE)
"""Files that only some diagnoses write."""

GOES_WITH = {TABLE: FEEDFORWARD, RESIDUAL_TABLE: RESIDUAL, SIMULATORS: ISAAC}
"""Files that repeat the content of another file, and that other file; both are written or neither."""
