"""What importing the package loads, what its first call compiles, and its types."""

import subprocess
import sys

import numpy
import numpy as np
import pytest

import phantom_dyn as dyn
from phantom_dyn import libraries
from phantom_dyn.array_types import Bool, Complex, Float, Int
from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import is_installed, missing_library, optional_library
from phantom_dyn.motion import read_only, side_by_side


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


HEAVY = {"numpy", "scipy", "matplotlib", "pinocchio", "numba", "pandas", "xarray", "plotly", "identification"}


def test_the_door_offers_what_it_documents():
    functions = {"load_robot", "read_recording", "diagnose", "identify", "excite", "check", "compare", "simulate"}
    assert functions | {"map_workspace", "Diagnosis", "PhantomDynError", "__version__"} == set(dyn.__all__)
    assert dyn.__doc__ is not None
    assert all(name in dyn.__doc__ for name in functions)


@pytest.mark.parametrize("name", [name for name in dyn.__all__ if name != "__version__"])
def test_every_name_exists_and_says_what_it_does(name):
    assert getattr(dyn, name).__name__ == name
    assert getattr(dyn, name).__doc__


def test_tab_completion_shows_the_names_of_the_entrance():
    assert dir(dyn) == sorted(dyn.__all__)


def test_a_name_that_there_is_not_lists_those_that_there_are():
    with pytest.raises(AttributeError, match=r"no attribute 'diagnosis_of', it offers Diagnosis, .*simulate"):
        _ = dyn.diagnosis_of


def test_the_import_loads_nothing_heavy():
    script = f"import phantom_dyn as dyn, sys; dir(dyn); print(*sorted(set(sys.modules) & {HEAVY!r}))"
    child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert child.stdout.split() == []


def test_loading_a_robot_loads_nothing_of_recordings():
    script = "import phantom_dyn as dyn, sys; dyn.load_robot('emps'); print('identification' in sys.modules)"
    child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert child.stdout.split() == ["False"]


def test_a_missing_library_is_named_with_the_command_that_installs_it():
    assert missing_library("rosbags") == (
        "Reading a ROS bag or MCAP needs rosbags, which is not installed: pip install 'phantom-dyn[ros]'."
    )


def test_what_can_be_imported_is_installed():
    assert (is_installed("numpy"), is_installed("no_such_library")) == (True, False)


def test_an_optional_library_is_the_module_itself():
    assert optional_library("numpy") is numpy


def test_an_optional_library_that_is_missing_is_refused_in_that_sentence(monkeypatch):
    monkeypatch.setattr(libraries, "is_installed", lambda _: False)
    with pytest.raises(UsageError, match=r"A table of findings.* needs pandas.* 'phantom-dyn\[tables\]'"):
        optional_library("pandas")


def test_an_array_that_may_be_written_to_is_copied(rng):
    given = rng.normal(size=(5, 2))
    kept = read_only(given)
    before = given.copy()
    given[:] = 0.0
    np.testing.assert_array_equal(kept, before)
    with pytest.raises(ValueError, match="read-only"):
        kept[0, 0] = 1.0


def test_a_copy_that_nobody_can_write_to_is_not_copied_again(rng):
    kept = read_only(rng.normal(size=(5, 2)))
    assert read_only(kept) is kept


def test_a_view_of_what_may_be_written_to_is_copied(rng):
    given = rng.normal(size=5)
    view = given[:]
    view.flags.writeable = False
    assert not np.shares_memory(read_only(view), given)


@pytest.mark.parametrize("count", [1, 4095, 4096, 10000])
def test_columns_side_by_side_are_those_of_numpy(rng, count):
    columns = list(rng.normal(size=(3, count)))
    found = side_by_side(columns)
    np.testing.assert_array_equal(found, np.column_stack(columns))
    assert read_only(found) is found
