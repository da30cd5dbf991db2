"""An effect that the recordings cannot show is not ruled out."""

import numpy as np
import pytest

from identification.diagnosis.judge.findings.untestable_rivals import with_untestable_rivals
from identification.diagnosis.result import EffectAt
from identification.diagnosis.search.rival_sets import RivalComparison


@pytest.mark.parametrize(("swing", "certain"), [(0.1, False), (1.5, True)])
def test_an_encoder_offset_over_a_small_arc_may_be_an_eccentric_disc(lab, planar2, swing, certain):
    # By hand: two explanations that look the same share the probability.
    prepared = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, 3, swing=swing)),))
    offset = prepared.term("encoder_offset", "elbow")
    found = with_untestable_rivals(prepared.search.problem, offset, np.array([0.03]), RivalComparison(0.9, ()))
    eccentric = EffectAt("encoder_eccentricity", "elbow")
    assert ((eccentric,) in [rival.effects for rival in found.rivals]) != certain
    assert found.probability == pytest.approx(0.9 / (1 + len(found.rivals)))
