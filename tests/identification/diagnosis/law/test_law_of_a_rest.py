"""The law of a rest, and of a diagnosis."""

import numpy as np
import pytest

import phantom_dyn as dyn
from benchmarks.laws.cases import make
from identification.diagnosis.law.find_law import law_of
from identification.diagnosis.result import JointGap
from rests import made_up_rest

JOINT = JointGap("j1", "N m", 1.0, 1.0, 0.1, 1200)


@pytest.fixture(scope="module")
def warming():
    """Coulomb friction that falls from 2 by 0.05 N m every second, about its mean at twelve seconds."""
    return law_of(made_up_rest(lambda x: (2.0 - 0.05 * (x["t"] - 12.0)) * np.sign(x["v.j1"])), (JOINT,))


def test_the_inputs_are_those_of_the_law(warming):
    assert set(warming[0].inputs) == {"v.j1", "t"}


def test_the_coefficients_are_those_of_the_law_as_a_torque_on_the_joint(warming):
    found = {term.term: term for term in warming[1].terms}
    assert found["sign(v)"].interval[0] < -2.0 < found["sign(v)"].interval[1]
    assert found["(t - 12)*sign(v)"].coefficient == pytest.approx(0.05, abs=0.003)


def test_units_are_told(warming):
    assert {term.term: term.unit for term in warming[1].terms}["(t - 12)*sign(v)"] == "N m/s"


def test_nearly_all_of_the_rest_is_foreseen_on_held_out_blocks(warming):
    assert warming[1].rest_closed > 0.98


def test_the_range_of_validity_is_that_of_the_recording(warming):
    assert warming[0].valid["t"] == pytest.approx((0.0, 24.0), abs=0.1)


def test_it_is_likened_to_a_law_of_the_literature(warming):
    assert warming[0].like == "friction that changes with time, as it does while a drive warms up"


@pytest.mark.parametrize("seed", range(6))
def test_noise_alone_has_no_law(seed):
    law, found = law_of(made_up_rest(lambda x: np.zeros(len(x["t"])), seed=seed), (JOINT,))
    assert law is None
    assert found.inputs == ()


@pytest.mark.parametrize("seed", range(3))
def test_slow_noise_of_a_second_has_no_law(seed):
    rng = np.random.default_rng(seed)
    slow = np.convolve(rng.normal(size=1300), np.exp(-np.arange(50) / 10.0), "valid")[:1200]
    law, _ = law_of(made_up_rest(lambda x: 0.1 * slow, noise=0.05, seed=seed), (JOINT,))
    assert law is None


def test_what_no_term_of_the_library_makes_has_no_formula():
    rng = np.random.default_rng(4)
    centres = rng.uniform(-1.0, 1.0, (25, 2))
    sizes = rng.choice([-1.0, 1.0], 25)

    def patches(x):
        near = (x["q.j1"][:, None] - centres[:, 0]) ** 2 + (x["v.j2"][:, None] - 2 * centres[:, 1]) ** 2 / 4
        return np.exp(-near / 0.02) @ sizes

    assert law_of(made_up_rest(patches), (JOINT,))[0] is None


def test_a_model_that_moves_within_its_bounds_is_not_taken_for_a_law():
    rest = made_up_rest(lambda x: 0.8 * x["tl.j1"], free=lambda x: x["tl.j1"], bound=1.0)
    assert law_of(rest, (JOINT,))[0] is None


def test_what_lies_beyond_the_bounds_of_the_model_is_a_law():
    rest = made_up_rest(lambda x: 3.0 * x["tl.j1"], free=lambda x: x["tl.j1"], bound=1.0)
    law, found = law_of(rest, (JOINT,))
    assert law is not None
    assert found.terms[0].coefficient == pytest.approx(-2.0, abs=0.05)


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
