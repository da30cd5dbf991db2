"""No model file of an identification leaves more than the given model. Oracle: known truths, Pinocchio's torques."""

from __future__ import annotations

import re

import pytest

from identification.data.signals import process_all
from identification.identify.exports import MJCF, URDF
from identification.identify.identification import Export
from identification.identify.identify import without_worse_files
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters


@pytest.fixture(scope="module")
def given(robots):
    return load_robot(robots / "planar2.urdf")


def judged(given, held, recorded):
    """Two files that hold a robot, judged on a recording of the given one."""
    logs, cutoff_hz = process_all((recorded(given, noise=0.02),), given)
    files = tuple(Export(name, "text", "", 0.0, 1e-6, ()) for name in (URDF, MJCF))
    return without_worse_files(files, {URDF: held, MJCF: given}, given, logs, cutoff_hz)


def test_a_file_that_leaves_more_is_not_written_and_says_where(given, recorded):
    urdf, _ = judged(given, with_parameters(given, 0.3 * standard_parameters(given)), recorded)
    assert urdf.text == ""
    assert re.match(r"Not written: on shoulder it would leave \d+\.\d+ N m on held-out data, where", urdf.left_out[0])


def test_the_given_model_in_a_file_is_written(given, recorded):
    _, mjcf = judged(given, given, recorded)
    assert mjcf.text == "text"
