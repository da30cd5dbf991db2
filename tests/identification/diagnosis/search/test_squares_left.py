"""What subsets of effects leave, from summed products. Oracle: the residual itself, sample by sample."""

from itertools import combinations

import numpy as np
import pytest

from identification.diagnosis.judge.judged_band import Judge, narrow_search
from identification.diagnosis.judge.shares import left_by
from identification.diagnosis.noise.noise_floor import noise_floor
from identification.diagnosis.search.squares_left import squares_left


@pytest.fixture(scope="module")
def planar(lab, planar2):
    """A plain search whose band is the recording's, and effects of which one scales all that is beside it."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.0, 1.0] + np.array([0.4, 0.0])
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    plain = narrow_search(prepared.search, prepared.noise)
    floor = noise_floor(prepared.session, prepared.columns, prepared.noise)
    places = [("coulomb_friction", "elbow"), ("torque_offset", "shoulder"), ("torque_constant", "elbow")]
    return plain, Judge(plain.problem, floor, floor), frozenset(prepared.term(*place) for place in places)


def test_every_subset_leaves_what_its_residual_says(planar):
    plain, judge, terms = planar
    left = squares_left(plain, terms)
    for size in range(len(terms) + 1):
        for some in map(frozenset, combinations(terms, size)):
            expected, found = left_by(judge, plain, some), left(some)
            np.testing.assert_allclose(found.counts.sum(axis=0), expected.counts.sum(axis=0))
            # The residual is low-passed across the edges of blocks, at which the fit changes.
            np.testing.assert_allclose(found.rms(), expected.rms(), rtol=2e-3)
