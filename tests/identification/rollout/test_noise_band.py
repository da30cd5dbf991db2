"""How far noise makes simulated motion stray. Oracle: right models stay within, wrong ones do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.result import Judgement, Unexplained
from identification.rollout.compare import Rollout
from identification.rollout.driven import given_torque
from identification.rollout.noise_band import borne_out_by_motion, strays
from identification.rollout.simulated_models import model_of
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.simulation.simulate import Cause


@pytest.fixture(scope="module")
def over(record, planar):
    """How far each joint of the planar arm strays over the band, with a cause and with noise of the torque [N m]."""
    made = record(planar)
    t, tau = made.log.motion.t, made.log.tau

    def of(size: float, noise: float) -> np.ndarray:
        causes = (Cause(effect_named("torque_offset"), "shoulder", np.array([size])),) if size else ()
        model = model_of(planar, causes)
        shots = tuple(replace(shot, window=replace(shot.window, fold=k % 4)) for k, shot in enumerate(made.shots()))
        wave = noise * np.sin(2.0 * np.pi * np.outer(t, [0.31, 0.37]))
        return strays(
            shots,
            lambda window, fold: model,
            lambda shot, known: given_torque(known, t, tau),
            (wave,),
            (0, 1, 2, 3),
            0.5,
        )

    return of


def test_the_right_model_strays_no_further_than_noise_makes_it(over):
    assert over(0.0, 0.02).max() < 1.0


def test_a_constant_torque_that_counts_as_no_noise_makes_a_joint_stray(over):
    assert over(1.0, 0.02)[0] > 1.0


def test_the_more_torque_counts_as_noise_the_less_is_beyond_it(over):
    # Closed form: where noise of the torque is all there is, the band grows with it.
    assert over(1.0, 4.0)[0] == pytest.approx(over(1.0, 2.0)[0] / 2.0, rel=0.1)


def test_a_model_whose_torque_shows_no_gap_but_which_strays_is_off_by_something_unknown(made_up):
    left = Unexplained(0.0, False, None, None)
    judgement = Judgement("no_gap", (), (), (), left, (), (), made_up().evidence)
    told = borne_out_by_motion(judgement, Rollout(0.5, {}, {}, strays={"j1": 1.2, "j2": 2.1}))
    assert (told.verdict, told.unexplained.joint) == ("unknown", "j2")
    assert borne_out_by_motion(judgement, Rollout(0.5, {}, {})) == judgement
    assert borne_out_by_motion(judgement, Rollout(0.5, {}, {}, strays={"j2": 1.9})) == judgement
    explained = replace(judgement, verdict="explained")
    assert borne_out_by_motion(explained, Rollout(0.5, {}, {}, strays={"j1": 2.2})) == explained
