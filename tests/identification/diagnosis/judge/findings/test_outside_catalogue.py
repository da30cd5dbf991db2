"""An effect is certain only if no structure outside of the catalogue explains its torque as well."""

import numpy as np
import pytest

from identification.diagnosis.judge.findings.bench import State
from identification.diagnosis.judge.findings.shown import shown_effects


@pytest.mark.parametrize(("begins", "certain"), [(0, True), (25, False)])
def test_a_spring_is_certain_if_it_acts_on_both_sides(lab, planar2, bench_of, begins, certain):
    # Known truth: a torque that is proportional to the position beyond some place, as of a spring that the joint
    # leaves.
    motion = lab.motion(2, 3)
    q = motion.q[:, 1]
    torque = -4.0 * np.maximum(q - np.percentile(q, begins), 0.0)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque[:, None] * [0.0, 1.0]),))
    spring = prepared.term("parasitic_spring", "elbow")
    shown = shown_effects(bench_of(prepared), State.of(frozenset([spring])))
    assert (shown.comparisons[spring].probability > 0.9) == certain
