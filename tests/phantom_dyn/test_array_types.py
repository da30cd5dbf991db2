"""Types of arrays: jaxtyping's where it is loaded, and nothing that a run of the command would have to load."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from phantom_dyn.array_types import Bool, Complex, Float, Int


@pytest.mark.parametrize(("kind", "dtype"), [(Bool, bool), (Complex, complex), (Float, float), (Int, int)])
def test_a_type_holds_arrays_of_its_numbers_and_shape_alone(kind, dtype):
    # Oracle: jaxtyping's own check, which conftest has loaded.
    other = float if dtype is int else int
    wanted = kind[np.ndarray, "2 nv"]
    assert isinstance(np.zeros((2, 3), dtype), wanted)
    assert not isinstance(np.zeros((3, 3), dtype), wanted)
    assert not isinstance(np.zeros((2, 3), other), wanted)


def test_the_whole_line_runs_without_loading_jaxtyping():
    code = "import sys, identification.pipeline; print('jaxtyping' in sys.modules, 'pinocchio' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
