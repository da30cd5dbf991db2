"""The benchmark of controllers. Oracles: a perfect model tracks, and a geometric mean by hand."""

import numpy as np
import pytest

from benchmarks.tracking_gain import ARM, controller, drawn_causes, error_ratio, mean_ratio, sines, tracking_error
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_model import corrected_model
from phantom_dyn import load_robot

pytestmark = pytest.mark.whole


def test_a_controller_of_the_true_model_hardly_errs():
    robot, rng = load_robot(ARM), np.random.default_rng(3)
    causes = drawn_causes(rng)
    effects = tuple(KnownEffect(c.effect.name, c.joint, tuple(np.asarray(c.theta).tolist())) for c in causes)
    reference = sines(rng, 3.0, robot.nv)
    true, given = (
        tracking_error(robot, causes, controller(corrected_model(robot, found), reference), reference)
        for found in (effects, ())
    )
    assert true < 2e-3
    assert true < 0.1 * given


def test_the_corrected_model_gives_the_better_controller():
    _, before, after = error_ratio(load_robot(ARM), np.random.default_rng((0, 2)))
    assert after < 0.5 * before


def test_the_mean_is_geometric_and_lies_in_its_interval():
    mean, low, high = mean_ratio(np.array([0.1, 0.4, 0.2, 0.2]), np.random.default_rng(0))
    assert mean == pytest.approx(0.2)
    assert low < mean < high
