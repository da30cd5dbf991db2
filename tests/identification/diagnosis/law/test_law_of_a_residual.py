"""The law of a residual, and of a diagnosis.

The oracles are transfer functions in closed form, and laws without memory that must not be taken for one.
"""

import numpy as np
import pytest
from scipy import signal

import phantom_dyn as dyn
from benchmarks.laws.cases import make
from identification.diagnosis.law.find_law import law_of
from identification.diagnosis.law.smooth import frequency_responses, input_gains
from identification.diagnosis.result import JointGap
from made_up_residual import RATE, made_up_residual

JOINT = JointGap("j1", "N m", 1.0, 1.0, 0.1, 1200)


@pytest.fixture(scope="module")
def warming():
    """Coulomb friction that falls from 2 by 0.05 N m every second, about its mean at twelve seconds."""
    return law_of(made_up_residual(lambda x: (2.0 - 0.05 * (x["t"] - 12.0)) * np.sign(x["v.j1"])), (JOINT,))


def test_the_inputs_are_those_of_the_law(warming):
    assert set(warming[0].inputs) == {"v.j1", "t"}


def test_the_coefficients_are_those_of_the_law_as_a_torque_on_the_joint(warming):
    found = {term.term: term for term in warming[1].terms}
    assert found["sign(v)"].interval[0] < -2.0 < found["sign(v)"].interval[1]
    assert found["(t - 12)*sign(v)"].coefficient == pytest.approx(0.05, abs=0.003)


def test_units_are_reported(warming):
    assert {term.term: term.unit for term in warming[1].terms}["(t - 12)*sign(v)"] == "N m/s"


def test_nearly_all_of_the_rest_is_foreseen_on_held_out_blocks(warming):
    assert warming[1].predicted_share > 0.98


def test_the_range_of_validity_is_that_of_the_recording(warming):
    assert warming[0].valid["t"] == pytest.approx((0.0, 24.0), abs=0.1)


def test_it_is_likened_to_a_law_of_the_literature(warming):
    assert warming[0].like == "friction that changes with time, as it does while a drive warms up"


@pytest.mark.parametrize("seed", range(6))
def test_noise_alone_has_no_law(seed):
    law, found = law_of(made_up_residual(lambda x: np.zeros(len(x["t"])), seed=seed), (JOINT,))
    assert law is None
    assert found.inputs == ()


@pytest.mark.parametrize("seed", range(3))
def test_slow_noise_of_a_second_has_no_law(seed):
    rng = np.random.default_rng(seed)
    slow = np.convolve(rng.normal(size=1300), np.exp(-np.arange(50) / 10.0), "valid")[:1200]
    law, _ = law_of(made_up_residual(lambda x: 0.1 * slow, noise=0.05, seed=seed), (JOINT,))
    assert law is None


def test_what_no_term_of_the_library_makes_has_no_formula():
    rng = np.random.default_rng(4)
    centres = rng.uniform(-1.0, 1.0, (25, 2))
    sizes = rng.choice([-1.0, 1.0], 25)

    def patches(x):
        near = (x["q.j1"][:, None] - centres[:, 0]) ** 2 + (x["v.j2"][:, None] - 2 * centres[:, 1]) ** 2 / 4
        return np.exp(-near / 0.02) @ sizes

    assert law_of(made_up_residual(patches), (JOINT,))[0] is None


def test_a_model_that_moves_within_its_bounds_is_not_taken_for_a_law():
    residual = made_up_residual(lambda x: 0.8 * x["tl.j1"], free=lambda x: x["tl.j1"], bound=1.0)
    assert law_of(residual, (JOINT,))[0] is None


def test_what_lies_beyond_the_bounds_of_the_model_is_a_law():
    residual = made_up_residual(lambda x: 3.0 * x["tl.j1"], free=lambda x: x["tl.j1"], bound=1.0)
    law, found = law_of(residual, (JOINT,))
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
    assert hose[1].unexplained.dependence.predicted_share > 0.9


def test_what_is_explained_has_no_law(tmp_path):
    make(0, tmp_path, null=True)
    unexplained = dyn.diagnose(tmp_path / "robot.urdf", tmp_path / "log.csv").result.unexplained
    assert unexplained.law is None
    assert unexplained.dependence is None


CORNER_HZ = 0.4
PEAK_HZ, DAMPING = 0.8, 0.15


def through(numerator, denominator, x):
    """An input through a transfer function, by `scipy.signal`."""
    return signal.lsim((numerator, denominator), x, np.arange(len(x)) / RATE)[1]


def creeping(x):
    """A spring in series with a damper: 3 N m s/rad below its corner."""
    w = 2 * np.pi * CORNER_HZ
    return 3.0 * through([w], [1.0, w], x["v.j1"])


def swinging(x):
    """A part on a spring with a resonance, 0.4 kg m^2."""
    w = 2 * np.pi * PEAK_HZ
    return 0.4 * through([w * w], [1.0, 2 * DAMPING * w, w * w], x["a.j1"])


@pytest.fixture(scope="module")
def creep():
    return law_of(made_up_residual(creeping, seconds=48.0), (JOINT,))


@pytest.fixture(scope="module")
def swing():
    return law_of(made_up_residual(swinging, seconds=48.0), (JOINT,))


def test_the_frequency_of_the_velocity_is_the_input_of_a_spring_behind_a_damper(creep):
    assert creep[0].inputs == ("freq(v.j1)",)


def test_its_formula_has_the_corner_and_the_damping(creep):
    (term,) = creep[1].terms
    hz = float(term.term.split()[1])
    assert term.term.startswith("low(v, ")
    assert hz == pytest.approx(CORNER_HZ, rel=0.3)
    assert term.coefficient == pytest.approx(-3.0, rel=0.25)


def test_it_holds_over_the_frequencies_of_the_motion(creep):
    low, high = creep[0].valid["freq(v.j1)"]
    assert 0.05 < low < 0.3
    assert 0.6 < high < 1.2


def test_gain_and_phase_are_those_of_the_transfer_function():
    (response,) = frequency_responses(made_up_residual(creeping, seconds=96.0), ("freq(v.j1)",))
    hz = np.array(response.hz)
    truth = -3.0 / (1.0 + 1j * hz / CORNER_HZ)
    assert response.unit == "N m/(rad/s)"
    np.testing.assert_allclose(response.gain, np.abs(truth), rtol=0.1)
    turned = np.array(response.phase) - np.degrees(np.angle(truth))
    np.testing.assert_allclose((turned + 180) % 360 - 180, 0.0, atol=6.0)


def test_their_bands_hold_the_transfer_function():
    (response,) = frequency_responses(made_up_residual(creeping, seconds=96.0), ("freq(v.j1)",))
    truth = np.abs(3.0 / (1.0 + 1j * np.array(response.hz) / CORNER_HZ))
    inside = (np.array(response.gain_low) <= 1.02 * truth) & (0.98 * truth <= np.array(response.gain_high))
    assert inside.mean() > 0.8


def test_a_resonance_is_a_response_to_the_motion(swing):
    assert swing[1].inputs == ("freq(v.j1)",)


def test_the_response_to_the_torque_is_reported_where_the_torque_comes_late():
    law, found = law_of(made_up_residual(lambda x: x["tl.j1"] - np.interp(x["t"] - 0.03, x["t"], x["tl.j1"])), (JOINT,))
    assert found.inputs == ("freq(tl.j1)",)
    assert law.like == "a torque that was filtered or comes late"


def test_a_response_that_no_short_formula_has_names_the_frequency_alone():
    rng = np.random.default_rng(5)
    kernel = rng.normal(size=12).repeat(8) / 20

    def law(x):
        return np.convolve(x["v.j1"], kernel)[: len(x["t"])]

    gains = input_gains(made_up_residual(law, seconds=96.0, noise=0.02))
    assert gains.frequency == "freq(v.j1)"


@pytest.mark.parametrize(
    "still",
    [
        lambda x: 2.0 * x["q.j1"] + 0.7 * x["v.j1"] - 0.4 * x["a.j1"],
        lambda x: 2.0 * np.sign(x["v.j1"]),
        lambda x: x["q.j1"] ** 3,
        lambda x: 2.0 * np.exp(-x["t"] / 6.0) * np.sign(x["v.j1"]),
    ],
    ids=["spring, damping and inertia", "friction", "hardening spring", "warming friction"],
)
def test_what_has_no_memory_is_no_frequency(still):
    residual = made_up_residual(still)
    assert input_gains(residual).frequency is None
    assert not any(name.startswith("freq") for name in law_of(residual, (JOINT,))[1].inputs)


@pytest.mark.parametrize("seed", range(4))
def test_noise_has_no_frequency(seed):
    assert input_gains(made_up_residual(lambda x: np.zeros(len(x["t"])), seed=seed)).frequency is None
