"""Terms of a law, their histories, and the search for a formula."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from identification.diagnosis.law.formula_search import (
    _votes_of_replicates,
    best_size,
    columns_of,
    gain_by_chance,
    losses_without_law,
    search_formula,
)
from identification.diagnosis.law.histories import bristle, slip
from identification.diagnosis.law.library import library
from identification.diagnosis.law.responses import delayed, laguerre, laguerre_gains, resonator
from identification.diagnosis.law.smooth import hats, input_curves, input_gains
from identification.engine.search.stepwise import gains
from made_up_residual import made_up_residual
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.described import FormulaTerm
from phantom_dyn.effects.friction.viscous_friction import ViscousFriction

REST = made_up_residual(lambda x: 0.0 * x["t"], seconds=9.0)

# Of what the made-up recording has; it is without temperatures.
SAID = [
    (effect.name, term.text)
    for effect in EFFECTS
    for term in effect.formula(lambda kind: 0.0)
    if "temp" not in term.text
]  # fmt: skip


class Windage(ViscousFriction):
    name = "windage"

    def __init__(self, kind: str, text: str, power: int):
        self.said = FormulaTerm(kind, text, lambda v: np.sign(v) * np.abs(v) ** power, "{speed}^" + str(power))

    def formula(self, middle):
        return (self.said,)


@pytest.mark.parametrize("text", [text for _, text in SAID if "(q" not in text])
def test_what_an_effect_says_is_in_the_library_once(text):
    assert [term.texts for term in library(REST)].count((text,)) == 1


def test_an_effect_that_joins_the_catalogue_joins_the_library(monkeypatch):
    before = library(REST)
    monkeypatch.setattr("identification.diagnosis.law.library.EFFECTS", (*EFFECTS, Windage("windage", "v^3", 3)))
    after = library(REST)
    (new,) = [term for term in after if term.kind == "windage"]
    assert (new.texts, new.inputs, new.per) == (("v^3",), frozenset({"v.j1"}), "(rad/s)^3")
    np.testing.assert_allclose(new.columns[0](REST.logs[0]), REST.logs[0].inputs["v.j1"] ** 3)
    assert [term.texts for term in after if term is not new] == [term.texts for term in before]


def test_a_term_that_is_listed_is_the_effects_own_where_one_says_it(monkeypatch):
    before = library(REST)
    monkeypatch.setattr("identification.diagnosis.law.library.EFFECTS", (*EFFECTS, Windage("windage", "v*|v|", 2)))
    after = library(REST)
    assert [term.kind for term in after if term.texts == ("v*|v|",)] == ["windage"]
    assert len(after) == len(before)


def test_a_term_about_a_place_is_about_the_middle_of_the_travel():
    # By hand: half way between the first and the last per cent of the positions.
    q = REST.logs[0].inputs["q.j1"]
    middle = float(f"{0.5 * sum(np.percentile(q, [1, 99])):.3g}")
    (spring,) = [term for term in library(REST) if term.kind == "spring"]
    np.testing.assert_allclose(spring.columns[0](REST.logs[0]), q - middle)


def _noise(seed: int):
    residual = made_up_residual(lambda x: np.zeros(len(x["t"])), seed=seed)
    return residual, columns_of(residual)


def test_the_best_term_of_the_library_gains_from_noise_what_chance_is_said_to_give():
    above, ratios = 0, []
    for seed in range(12):
        residual, columns = _noise(seed)
        products = columns.products.summed(np.ones(len(residual.folds)))
        ratios.append(gains(columns.terms, products, ()).max() / gain_by_chance(residual, columns, residual.y))
        above += ratios[-1] > 1.0
    assert above <= 1
    assert np.median(ratios) > 0.4


def test_a_formula_that_held_out_blocks_like_by_chance_is_dropped(monkeypatch):
    monkeypatch.setattr("identification.diagnosis.law.formula_search.best_size", lambda loss: 2)
    residual, columns = _noise(3)
    assert search_formula(residual, columns, losses_without_law(residual, columns)).chosen == ()


def test_a_longer_formula_has_to_be_surely_better():
    loss = np.array([[10.0] * 8, [1.0] * 8, [1.5, 0.4] * 4])
    assert best_size(loss) == 1


def test_a_formula_that_is_better_on_every_block_is_taken():
    assert best_size(np.array([[10.0] * 8, [5.0] * 8, [1.0] * 8])) == 2


def test_without_a_law_the_model_moves_to_its_bound_and_no_further():
    residual = made_up_residual(lambda x: 3.0 * x["tl.j1"], noise=0.01, free=lambda x: x["tl.j1"], bound=1.0)
    left = losses_without_law(residual, columns_of(residual)).sum()
    assert left == pytest.approx(4.0 * np.sum(residual.series("tl.j1") ** 2), rel=1e-3)


def test_replicates_that_draw_no_sample_choose_no_term():
    # Closed form: all samples are in one of sixteen blocks, which (1 - 1/16)^16 of the replicates do not draw.
    residual = made_up_residual(lambda x: 3.0 * x["tl.j1"])
    log = residual.logs[0]
    residual = replace(residual, logs=(replace(log, weight=(residual.blocks == 0).astype(float)),))
    columns = columns_of(residual)
    chosen = (next(k for k, term in enumerate(columns.library) if term.inputs == {"tl.j1"}),)
    input_votes = _votes_of_replicates(residual, columns, chosen)[2]
    drawn = 1.0 - (1.0 - 1.0 / 16.0) ** 16
    assert max(input_votes.values()) == pytest.approx(drawn, abs=3.0 * np.sqrt(drawn * (1.0 - drawn) / 40))


T = np.linspace(0.0, 20.0, 20001)

PATH = 0.4 * np.sin(1.1 * T) + 0.15 * np.sin(3.7 * T)


def test_a_bristle_follows_its_differential_equation():
    z = np.zeros(len(PATH))
    for k in range(1, len(PATH)):
        step = PATH[k] - PATH[k - 1]
        z[k] = z[k - 1] + step / 0.1 * (1.0 - z[k - 1] * np.sign(step))
    np.testing.assert_allclose(bristle(PATH, 0.1), z, atol=5e-3)


def test_a_slip_element_bends_until_it_slides():
    z = np.zeros(len(PATH))
    for k in range(1, len(PATH)):
        z[k] = np.clip(z[k - 1] + (PATH[k] - PATH[k - 1]) / 0.1, -1.0, 1.0)
    np.testing.assert_allclose(slip(PATH, 0.1), z, atol=1e-9)


def test_a_joint_that_stands_keeps_its_state():
    path = np.concatenate([np.linspace(0.0, 0.05, 50), np.full(50, 0.05), np.linspace(0.05, 0.06, 10)])
    z = slip(path, 0.1)
    np.testing.assert_allclose(z[50:100], 0.5)
    np.testing.assert_allclose(z[-1], 0.6)


DT = 0.004

TIMES = np.arange(5000) * DT

X = 0.7 + np.sin(2.0 * TIMES) + 0.4 * np.sin(7.0 * TIMES + 1.0)


def test_a_resonator_is_the_second_order_of_held_inputs():
    w, d = 2 * np.pi * 1.3, 0.2
    a, b, c, _, _ = signal.cont2discrete(
        (np.array([[0.0, w], [-w, -2 * d * w]]), np.array([[0.0], [w]]), np.eye(2), np.zeros((2, 1))), DT
    )
    state, wanted = np.array([X[0], 0.0]), [[X[0], 0.0]]
    for x in X[1:]:
        state = a @ state + b[:, 0] * x
        wanted.append(c @ state)
    np.testing.assert_allclose(resonator(X, DT, 1.3, 0.2), wanted, atol=1e-9)


def test_a_delayed_series_is_its_own_past():
    np.testing.assert_allclose(delayed(X, TIMES, 0.1)[25:], X[:-25], atol=1e-12)
    np.testing.assert_allclose(delayed(X, TIMES, 0.1)[:25], X[0])


def test_the_series_of_laguerre_are_orthogonal_to_an_impulse():
    impulse = np.concatenate([[0.0], [1.0], np.zeros(4000)])
    series = laguerre(impulse, DT, 1.0, 5)
    gram = series.T @ series
    np.testing.assert_allclose(gram / gram[0, 0], np.eye(5), atol=1e-9)


def test_their_gains_are_the_fourier_transforms_of_their_impulses():
    impulse = np.concatenate([[0.0], [1.0], np.zeros(2**14 - 2)])
    hz = np.fft.rfftfreq(len(impulse), DT)[[3, 40, 400]]
    through = np.fft.rfft(laguerre(impulse, DT, 1.0, 4), axis=0)[[3, 40, 400]]
    moved = np.exp(2j * np.pi * hz * DT)[:, None]
    np.testing.assert_allclose(laguerre_gains(hz, DT, 1.0, 4), through * moved, atol=1e-9)


def test_linear_functions_are_interpolated_exactly():
    places = np.array([-1.0, -0.2, 0.5, 2.0])
    x = np.linspace(-1.0, 2.0, 31)
    np.testing.assert_allclose(hats(x, places) @ (3 * places + 1), 3 * x + 1)


def test_beyond_the_ends_the_value_of_the_end_holds():
    np.testing.assert_allclose(hats(np.array([-5.0, 9.0]), np.array([0.0, 1.0])) @ np.array([2.0, 7.0]), [2.0, 7.0])


def test_the_input_of_the_law_foresees_most():
    gains = input_gains(made_up_residual(lambda x: x["q.j1"] ** 3)).listed
    assert gains[0].inputs == ("q.j1",)
    assert gains[0].gain > 0.9 > gains[0].chance


def test_an_input_that_has_no_part_is_not_beyond_chance():
    gains = {one.inputs: one for one in input_gains(made_up_residual(lambda x: x["q.j1"] ** 3)).listed}
    assert gains["v.j2",].gain < gains["v.j2",].chance


def test_a_pair_foresees_what_neither_of_its_inputs_does():
    gains = {
        one.inputs: one.gain for one in input_gains(made_up_residual(lambda x: x["q.j2"] * np.sign(x["v.j1"]))).listed
    }
    best = max(gains, key=lambda names: gains[names])
    assert set(best) in ({"v.j1", "q.j2"}, {"dx.j1", "q.j2"})
    assert gains[best] > 0.8 > 0.4 > max(gains["v.j1",], gains["q.j2",])


def test_a_curve_is_the_torque_on_the_joint_and_its_band_holds_the_truth():
    (curve,) = input_curves(made_up_residual(lambda x: 2.0 * x["q.j1"]), ("q.j1",))
    x, middle = np.array(curve.x), np.array(curve.middle)
    np.testing.assert_allclose(middle[3:-3], -2.0 * x[3:-3], atol=0.1)
    inside = (np.array(curve.low) <= -2.0 * x + 0.03) & (-2.0 * x - 0.03 <= np.array(curve.high))
    assert inside.mean() > 0.8


def test_friction_has_a_curve_for_each_direction():
    curves = input_curves(made_up_residual(lambda x: x["q.j1"] * np.sign(x["v.j1"])), ("q.j1", "v.j1"))
    assert [(one.input, one.direction) for one in curves] == [
        ("q.j1", "forwards"), ("q.j1", "backwards"), ("v.j1", ""),
    ]  # fmt: skip
