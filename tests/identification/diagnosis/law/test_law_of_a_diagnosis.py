"""The oracle is the law that a generator of its own put into the recording."""

import pytest

import phantom_dyn as dyn
from benchmarks.laws.cases import make


@pytest.fixture(scope="module")
def hose(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hose")
    case = make(20, folder)
    assert case.name == "hose"
    return case, dyn.diagnose(folder / "robot.urdf", folder / "log.csv").result


def test_the_inputs_of_the_law_are_named(hose):
    case, diagnosis = hose
    named = frozenset(diagnosis.unexplained.law.inputs)
    assert all(named & group for group in case.law.required)
    assert named <= case.law.allowed


def test_it_closes_nearly_all_of_what_the_findings_leave(hose):
    assert hose[1].unexplained.dependence.rest_closed > 0.9


def test_what_is_explained_has_no_law(tmp_path):
    make(0, tmp_path, null=True)
    unexplained = dyn.diagnose(tmp_path / "robot.urdf", tmp_path / "log.csv").result.unexplained
    assert unexplained.law is None
    assert unexplained.dependence is None
