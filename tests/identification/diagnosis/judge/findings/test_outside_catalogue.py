"""An effect is certain only if no structure outside of the catalogue explains its torque as well."""

import numpy as np
import pytest

from identification.diagnosis.judge.findings import outside_catalogue
from identification.diagnosis.judge.findings.gate_state import LoopState
from identification.diagnosis.judge.findings.shown import shown_effects
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.rival_sets import RivalComparison


@pytest.mark.parametrize(("begins", "certain"), [(0, True), (25, False)])
def test_a_spring_is_certain_if_it_acts_on_both_sides(lab, planar2, context_of, begins, certain):
    # Known truth: a torque that is proportional to the position beyond some place, as of a spring that the joint
    # leaves.
    motion = lab.motion(2, 3)
    q = motion.q[:, 1]
    torque = -4.0 * np.maximum(q - np.percentile(q, begins), 0.0)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque[:, None] * [0.0, 1.0]),))
    spring = prepared.term("parasitic_spring", "elbow")
    shown = shown_effects(context_of(prepared), LoopState.of(frozenset([spring])))
    assert (shown.comparisons[spring].probability > 0.9) == certain


def test_a_rival_that_is_no_more_probable_enough_leaves_its_share_to_the_others(lab, planar2, monkeypatch):
    # By hand: of 30 % for the catalogue a rival of a tenth has 3 %, and 4 to 5 parts remain.
    motion = lab.motion(2)
    search = lab.prepared(planar2, (lab.recording(planar2, motion),)).search
    monkeypatch.setattr(outside_catalogue, "_share_of_known_causes", lambda *_: 0.3)
    likely, unlikely = (
        Rival((EffectAt(name, "elbow"),), share) for name, share in (("payload", 0.4), ("cogging", 0.1))
    )
    comparison = RivalComparison(0.5, (likely, unlikely))
    found = outside_catalogue.weighed_with_structures(search, frozenset(), search.terms[0], comparison, ())
    assert [found.probability, *(one.probability for one in found.rivals)] == pytest.approx([0.5 / 3, 0.4 / 3])
