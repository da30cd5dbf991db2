import numpy as np
import pytest

from identification.diagnosis.fit.flexible import (
    displacement_since_reversal,
    ridge_predictions,
    state_features,
)
from identification.engine.products.blocks import Block


def best(*data, **options) -> tuple[list[np.ndarray], float]:
    """What the best ridge predicts, and its mean squared error."""
    return min(ridge_predictions(*data, **options), key=lambda one: one[1])


def test_displacement_starts_anew_at_every_reversal():
    q = np.array([0.0, 1.0, 3.0, 2.0, 1.5, 1.8, 2.0])
    v = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
    np.testing.assert_allclose(displacement_since_reversal(q, v), [0, 1, 3, 0, -0.5, 0, 0.2])


def features(quiet, row: int = 1) -> list[np.ndarray]:
    return [state_features(quiet.columns, quiet.logs[0], 0, row)]


def everything(quiet) -> list[np.ndarray]:
    return [np.ones(len(quiet.logs[0].samples), dtype=bool)]


def test_features_are_the_same_on_every_call(quiet):
    np.testing.assert_array_equal(features(quiet)[0], features(quiet)[0])


@pytest.mark.parametrize("law", ["cubic friction", "spring that hardens"])
def test_a_smooth_function_of_the_state_is_predicted_on_unseen_blocks(quiet, law):
    # Known truth: laws that are in no catalogue.
    log = quiet.logs[0]
    q, v = log.motion.q[log.samples, 1], log.motion.v[log.samples, 1]
    y = 0.4 * v**3 if law == "cubic friction" else q + 2 * q**3
    _, error = best(features(quiet), [y], everything(quiet), quiet.blocks, quiet.folds)
    assert error < 0.05 * np.var(y)


def test_noise_is_not_predicted(quiet, rng):
    y = rng.normal(size=len(quiet.logs[0].samples))
    predicted, error = best(features(quiet), [y], everything(quiet), quiet.blocks, quiet.folds)
    assert error > 0.9 * np.var(y)
    assert np.corrcoef(predicted[0], y)[0, 1] < 0.2


def test_no_block_is_predicted_by_a_fit_that_has_seen_it(quiet, rng):
    # What is measured in a block has no say in its own prediction: change it and the prediction stays.
    x, use = features(quiet), everything(quiet)
    y = rng.normal(size=len(quiet.logs[0].samples))
    block = quiet.blocks[3]
    changed = y.copy()
    mine = np.flatnonzero(quiet.folds == quiet.folds[3])
    for k in mine:
        changed[quiet.blocks[k].start : quiet.blocks[k].stop] *= -1.0
    part = slice(block.start, block.stop)
    first = best(x, [y], use, quiet.blocks, quiet.folds)[0][0][part]
    second = best(x, [changed], use, quiet.blocks, quiet.folds)[0][0][part]
    # The strength of the ridge is chosen by the errors, so a stronger one may be taken: the direction is the same.
    assert abs(np.corrcoef(first, second)[0, 1]) > 0.9


def test_samples_that_are_not_used_have_no_say(quiet):
    log = quiet.logs[0]
    y = 0.4 * log.motion.v[log.samples, 1]
    use = everything(quiet)
    use[0][::7] = False
    wild = np.where(use[0], y, 1e3)
    clean = best(features(quiet), [y], use, quiet.blocks, quiet.folds)
    spoilt = best(features(quiet), [wild], use, quiet.blocks, quiet.folds)
    np.testing.assert_allclose(spoilt[0][0], clean[0][0], atol=1e-9)
    assert spoilt[1] == pytest.approx(clean[1])


def test_the_better_of_some_features_and_of_all_predicts(quiet, rng):
    use, y = everything(quiet), rng.normal(size=len(quiet.columns.residual[0]))
    x = features(quiet)
    some = best([part[:, :3] for part in x], [y], use, quiet.blocks, quiet.folds)
    every = best(x, [y], use, quiet.blocks, quiet.folds)
    both = best(x, [y], use, quiet.blocks, quiet.folds, first=(3,))
    better = min(some, every, key=lambda result: result[1])
    assert both[1] == pytest.approx(better[1], rel=1e-12)
    np.testing.assert_allclose(both[0][0], better[0][0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("features_more", [4, 400], ids=["more samples", "more features"])
def test_each_fold_is_predicted_by_the_ridge_fit_of_the_others(features_more, rng):
    # Oracle: the normal equations of a ridge fit of unit-size features, written out for each fold.
    count = 120
    blocks = tuple(Block(0, start, start + 20, start + (5 if start else 0)) for start in range(0, count, 20))
    folds = np.array([0, 1, 2, 0, 1, -1])
    x = rng.normal(size=(count, features_more)) * rng.uniform(0.1, 10.0, features_more)
    y = x[:, 0] + rng.normal(size=count)
    use = rng.random(count) < 0.9
    fold_of = np.repeat(folds, 20)
    scaled = x / np.sqrt((x[use] ** 2).sum(axis=0) / use.sum())
    core = np.concatenate([np.arange(b.core, b.stop) for b in blocks])
    judged = core[use[core]]
    results = list(ridge_predictions([x], [y], [use], blocks, folds, first=(3,)))
    assert len(results) == 6
    strengths = [(k, ridge) for k in (3, features_more) for ridge in (1e-4, 1e-2, 1.0)]
    for (predicted, error), (k, ridge) in zip(results, strengths, strict=True):
        wanted = np.empty(count)
        for fold in (-1, 0, 1, 2):
            train = use & (fold_of >= 0) & (fold_of != fold)
            a = scaled[train, :k].T @ scaled[train, :k] + ridge * use.sum() * 1e-2 * np.eye(k)
            wanted[fold_of == fold] = scaled[fold_of == fold, :k] @ np.linalg.solve(a, scaled[train, :k].T @ y[train])
        np.testing.assert_allclose(predicted[0], wanted, rtol=1e-6, atol=1e-7)
        assert error == pytest.approx(np.mean((y - wanted)[judged] ** 2), rel=1e-6)


def test_without_samples_nothing_is_predicted(quiet):
    x, none = features(quiet), [np.zeros(len(quiet.logs[0].samples), dtype=bool)]
    for predicted, error in ridge_predictions(x, [np.ones(len(x[0]))], none, quiet.blocks, quiet.folds):
        assert error == 0.0
        assert not predicted[0].any()


def test_a_last_fold_without_samples_is_predicted_by_the_fit_on_all_others(quiet, rng):
    # Oracle: the same blocks outside all folds.
    x, use, y = features(quiet), everything(quiet), [rng.normal(size=len(quiet.logs[0].samples))]
    last = quiet.folds == quiet.folds.max()
    for without, block in zip(last, quiet.blocks, strict=True):
        use[0][block.start : block.stop] = not without
    predicted, _ = best(x, y, use, quiet.blocks, quiet.folds)
    outside, _ = best(x, y, use, quiet.blocks, np.where(last, -1, quiet.folds))
    np.testing.assert_allclose(predicted[0], outside[0], rtol=1e-9, atol=1e-12)
