"""``import phantom_dyn as dyn``: its names, and that nothing is loaded before it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import phantom_dyn as dyn

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
