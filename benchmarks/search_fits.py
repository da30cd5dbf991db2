"""Count how many sets of effects the searches of a diagnosis fit for each joint.

    python benchmarks/search_fits.py ROBOT LOG [LOG ...] [OPTION ...]    # as for phantom-dyn diagnose

A search stops after a number of fits that no robot needs whose gap the catalogue can explain (`most_fits`).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from identification import pipeline
from identification.cli.main import main as phantom_dyn
from identification.diagnosis.columns.session import Session
from identification.diagnosis.explanation import Explanation, explanation_of
from identification.stages import Progress


def counted(session: Session, progress: Progress) -> Explanation:
    """Explain the gap, and print the number of fits."""
    found = explanation_of(session, progress)
    joints, stopped = session.robot.nv, " (stopped)" if found.endless else ""
    print(f"{found.fits} sets fitted, {found.fits / joints:.0f} for each of {joints} joints{stopped}")
    return found


if __name__ == "__main__":
    pipeline.explanation_of = counted
    with tempfile.TemporaryDirectory() as folder:
        raise SystemExit(phantom_dyn(["diagnose", *sys.argv[1:], "--quick", "--out", folder]))
