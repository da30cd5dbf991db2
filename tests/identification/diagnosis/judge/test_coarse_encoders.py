"""Findings of coarse readings. Oracle: closed forms on squares written out by hand."""

import numpy as np
import pytest

from identification.diagnosis.fit.gap import Sums
from identification.diagnosis.judge.coarse_encoders import Rounded, findings_of, rounded
from identification.diagnosis.noise.encoder_noise import Coarse

FLOOR = np.array([0.1, 0.2])


def coarse_elbow(*torque: np.ndarray) -> Coarse:
    return Coarse(1, 2e-3, torque)


def found(energy: list[float], gap: float, samples: float = 400.0):
    """The finding of a coarse elbow whose rounding has this mean square, where the given model has so much of noise."""
    before = Sums(np.outer([samples], gap * FLOOR**2), np.full((1, 2), samples))
    return before, Rounded((coarse_elbow(),), np.array([energy]))


def test_the_energies_of_several_coarse_joints_add():
    both = Rounded((coarse_elbow(), coarse_elbow()), np.array([[0.1, 0.2], [0.3, 0.4]]))
    np.testing.assert_allclose(both.total, [0.4, 0.6])


def test_what_rounding_closes_is_its_share_of_the_gap(planar2):
    # By hand: (0.005 / 0.01 + 0.02 / 0.04) / 2 = 0.5 of a gap of 5 - 1 = 4.
    before, rounding = found([0.005, 0.02], 5.0)
    (finding,) = findings_of(planar2, rounding, before, FLOOR)
    assert (finding.effect, finding.joint) == ("encoder_quantization", "elbow")
    assert finding.gap_closed == pytest.approx(0.125)
    # Known to twice the root of one over the 400 samples of a joint.
    assert finding.gap_closed_interval == pytest.approx((0.125 * 0.9, 0.125 * 1.1))


def test_rounding_closes_no_more_than_the_whole_gap(planar2):
    before, rounding = found([0.02, 0.08], 1.5)
    (finding,) = findings_of(planar2, rounding, before, FLOOR)
    assert finding.gap_closed == 1.0
    assert finding.gap_closed_interval == pytest.approx((0.9, 1.0))


def test_the_step_is_known_to_a_hundredth_of_itself(planar2):
    before, rounding = found([0.005, 0.02], 5.0)
    step = findings_of(planar2, rounding, before, FLOOR)[0].parameters["step"]
    assert (step.value, step.unit) == (2e-3, "rad")
    assert step.std == pytest.approx(2e-5)


@pytest.mark.parametrize(("share", "kept"), [(0.02, 0), (0.2, 1)])
def test_a_coarse_reading_counts_where_it_makes_a_twentieth_of_the_noise(quiet, share, kept):
    # Known truth: of the noise that the recording has, a share of its square on the elbow and nothing on the shoulder.
    torque = tuple(np.sqrt(share) * part * [0.0, 1.0] for part in quiet.noise)
    floor = np.array([1e6, 1e6])
    rounding = rounded(quiet.problem, (coarse_elbow(*torque),), floor, quiet.noise)
    assert len(rounding.coarse) == kept
    assert rounding.energy.shape == (kept, 2)


def test_a_coarse_reading_counts_where_it_makes_a_twentieth_of_the_floor(quiet):
    # Known truth: a spurious torque of one on the elbow in every sample, far below the noise above the judged band.
    one = tuple(np.ones_like(part) * [0.0, 1.0] for part in quiet.noise)
    loud = tuple(1e6 * np.ones_like(part) for part in quiet.noise)
    for square, kept in ((19.0, 1), (21.0, 0)):
        rounding = rounded(quiet.problem, (coarse_elbow(*one),), np.array([1e9, np.sqrt(square)]), loud)
        assert len(rounding.coarse) == kept
        np.testing.assert_allclose(rounding.energy, np.array([[0.0, 1.0]])[:kept], atol=1e-9)


def test_of_several_coarse_readings_those_that_matter_are_kept(quiet):
    one, less = (tuple(size * np.ones_like(part) for part in quiet.noise) for size in (1.0, 1e-3))
    loud = tuple(1e6 * np.ones_like(part) for part in quiet.noise)
    joints = (coarse_elbow(*less), coarse_elbow(*one), coarse_elbow(*less))
    assert rounded(quiet.problem, joints, np.ones(2), loud).coarse == joints[1:2]


def test_what_a_few_samples_say_of_rounding_is_not_below_zero(planar2):
    # Closed form: of one sample the share is known to twice itself; of none it is taken as one.
    for samples in (1.0, 0.25):
        before, rounding = found([0.005, 0.02], 5.0, samples)
        (finding,) = findings_of(planar2, rounding, before, FLOOR)
        assert finding.gap_closed_interval[0] == 0.0
        assert finding.gap_closed_interval[1] == pytest.approx(min(3.0 * finding.gap_closed, 1.0))


def test_rounding_without_a_gap_closes_all_of_it(planar2):
    before, rounding = found([0.005, 0.02], 1.0)
    assert findings_of(planar2, rounding, before, FLOOR)[0].gap_closed == 1.0
