"""A gap that no possible noise makes has a cause. Oracle: a spring that was put into the recording."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.judge.findings.certain_gaps import closes_certain_gap
from identification.diagnosis.judge.shares import residual_sums_with


@pytest.mark.parametrize(("noise", "certain"), [(0.5, True), (2.0, False)])
def test_a_spring_closes_a_certain_gap_if_noise_cannot_be_as_large_as_its_torque(
    lab, planar2, context_of, noise, certain
):
    motion = lab.motion(2, 3)
    torque = -3.0 * motion.q[:, 1:] * [0.0, 1.0]
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    context, spring = context_of(prepared), prepared.term("parasitic_spring", "elbow")
    left = residual_sums_with(context.plain, frozenset()).rms()
    judged = replace(context.residuals.judged_band_of(frozenset()), highest=np.maximum(noise * left, 1e-3))
    context = replace(context, residuals=replace(context.residuals, judged_band_of=lambda _: judged))
    assert closes_certain_gap(context, frozenset([spring]), spring) == certain
