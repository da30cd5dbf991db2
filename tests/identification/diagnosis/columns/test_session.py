"""Sessions of recordings, and which are refused. Oracle: where a made recording has gaps is known."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.columns.session import session_of
from phantom_dyn.errors import LogError


@pytest.fixture
def whole(lab, planar2) -> Recording:
    """Twenty seconds without a gap."""
    return lab.recording(planar2, lab.motion(2, 4, seconds=20.0))


def with_rows(recording: Recording, kept: np.ndarray) -> Recording:
    """Some samples of a recording."""
    assert recording.tau is not None
    return replace(recording, t=recording.t[kept], q=recording.q[kept], tau=recording.tau[kept])


def test_blocks_of_samples_shorter_than_the_filter_are_refused_with_both_lengths(whole, planar2):
    blocks = with_rows(whole, whole.t % 0.32 < 0.16)
    told = r"sim\.csv: gaps in time .* leave too few samples .* \(the longest stretch without lasts 0\.16 s, .* record"
    with pytest.raises(LogError, match=told):
        session_of(planar2, (blocks,))


def test_one_stretch_that_is_long_enough_is_used(whole, planar2):
    session = session_of(planar2, (with_rows(whole, (whole.t % 0.32 < 0.16) | (whole.t > 5.0)),))
    used = session.logs[0].motion.t[session.logs[0].samples[session.logs[0].valid_in_band]]
    assert len(used)
    assert used.min() > 5.0


@pytest.mark.parametrize(("last", "enough"), [(5.0, True), (8.0, False)])
def test_blocks_that_gaps_leave_no_sample_of_are_not_counted(lab, planar2, last, enough):
    # Of ten blocks of a second at least four have to be left, to be held out in turn.
    recording = replace(lab.recording(planar2, lab.motion(2, 1)), excluded=((0.0, last),))
    if enough:
        assert len(session_of(planar2, (recording,)).blocks) >= 4
    else:
        with pytest.raises(LogError, match=r"sim\.csv: gaps in time and excluded .* leave too few samples to"):
            session_of(planar2, (recording,))
