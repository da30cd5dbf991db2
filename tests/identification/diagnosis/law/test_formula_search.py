"""The oracles are fresh noise, whose gains are chance, and the closed form of a mean square."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.law.formula_search import (
    _repeated,
    best_size,
    chance,
    columns_of,
    search_formula,
    without_law,
)
from identification.engine.search.stepwise import gains
from rests import made_up_rest


def _noise(seed: int):
    rest = made_up_rest(lambda x: np.zeros(len(x["t"])), seed=seed)
    return rest, columns_of(rest)


def test_the_best_term_of_the_library_gains_from_noise_what_chance_is_said_to_give():
    above, ratios = 0, []
    for seed in range(12):
        rest, columns = _noise(seed)
        products = columns.products.summed(np.ones(len(rest.folds)))
        ratios.append(gains(columns.terms, products, ()).max() / chance(rest, columns, rest.y))
        above += ratios[-1] > 1.0
    assert above <= 1
    assert np.median(ratios) > 0.4


def test_a_formula_that_held_out_blocks_like_by_chance_is_dropped(monkeypatch):
    monkeypatch.setattr("identification.diagnosis.law.formula_search.best_size", lambda loss: 2)
    rest, columns = _noise(3)
    assert search_formula(rest, columns, without_law(rest, columns)).chosen == ()


def test_a_longer_formula_has_to_be_surely_better():
    loss = np.array([[10.0] * 8, [1.0] * 8, [1.5, 0.4] * 4])
    assert best_size(loss) == 1


def test_a_formula_that_is_better_on_every_block_is_taken():
    assert best_size(np.array([[10.0] * 8, [5.0] * 8, [1.0] * 8])) == 2


def test_without_a_law_the_model_moves_to_its_bound_and_no_further():
    rest = made_up_rest(lambda x: 3.0 * x["tl.j1"], noise=0.01, free=lambda x: x["tl.j1"], bound=1.0)
    left = without_law(rest, columns_of(rest)).sum()
    assert left == pytest.approx(4.0 * np.sum(rest.series("tl.j1") ** 2), rel=1e-3)


def test_replicates_that_draw_no_sample_choose_no_term():
    # Closed form: all samples are in one of sixteen blocks, which (1 - 1/16)^16 of the replicates do not draw.
    rest = made_up_rest(lambda x: 3.0 * x["tl.j1"])
    log = rest.logs[0]
    rest = replace(rest, logs=(replace(log, weight=(rest.blocks == 0).astype(float)),))
    columns = columns_of(rest)
    chosen = (next(k for k, term in enumerate(columns.library) if term.inputs == {"tl.j1"}),)
    input_votes = _repeated(rest, columns, chosen)[2]
    drawn = 1.0 - (1.0 - 1.0 / 16.0) ** 16
    assert max(input_votes.values()) == pytest.approx(drawn, abs=3.0 * np.sqrt(drawn * (1.0 - drawn) / 40))
