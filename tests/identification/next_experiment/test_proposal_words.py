from __future__ import annotations

import numpy as np

from identification.diagnosis.result import EffectAt
from identification.excitation.motion_shapes import FourierSeries
from identification.next_experiment.candidates import Candidate
from identification.next_experiment.hypotheses import Hypothesis
from identification.next_experiment.proposal_words import proposal_words
from identification.next_experiment.separation import Pair
from identification.next_experiment.trials import Trial

MOTION = Candidate("Fourier series", FourierSeries(10.0, 4), np.zeros((9, 1)))
PAIR = Pair(*(Hypothesis((EffectAt(name, "pin"),), 0.5, ()) for name in ("viscous_friction", "input_delay")))


def test_softer_gains_are_asked_for_in_the_sentence():
    trial = Trial(MOTION, None, 0.25, np.array([0.9]), np.array([40.0]), 0.9)
    said = proposal_words((PAIR,), trial, "next.csv", 0.9).replace("\xa0", " ")
    assert said.startswith(
        "Record the motion of next.csv with the gains of the position controllers at 25 % of those in robot.yaml"
        " (10 s, Fourier series"
    )
    assert "), write these gains as its controller beside its file name in recordings.yaml, and diagnose it" in said
    assert said.endswith(
        "with a probability of 90 % it separates viscous friction on joint pin from an input delay on joint pin."
    )


def test_of_many_pairs_one_is_told_and_the_others_counted():
    def cause(effect: str, joint: str) -> Hypothesis:
        return Hypothesis((EffectAt(effect, joint),), 0.5, ())

    pairs = tuple(Pair(cause("viscous_friction", f"j{k}"), cause("coulomb_friction", f"j{k}")) for k in range(5))
    trial = Trial(MOTION, None, 0.25, np.array([0.9]), np.array([40.0]), 0.9)
    said = proposal_words(pairs, trial, "next.csv", 0.9)
    assert said.endswith("friction on joint j0 from Coulomb friction on joint j0, and 4 more causes from others.")
    assert "j1" not in said
