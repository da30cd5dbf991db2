"""What a diagnosis works on. Oracle: a made recording of two hours."""

import numpy as np

from identification.data.recording import Recording
from identification.diagnosis.columns.prepared import prepared


def test_what_a_diagnosis_works_on_holds_nothing_of_a_long_recording(planar2):
    t = np.arange(0.0, 7200.0, 0.05)
    q = np.column_stack([np.sin(t), np.cos(t)])
    whole = Recording("long.csv", planar2.joint_names, t, q, np.ones_like(q))
    given = prepared(planar2, (whole,))
    assert len(given.seen) == 15
    for part in given.seen:
        assert not any(np.shares_memory(kept, raw) for kept, raw in ((part.t, t), (part.q, q), (part.tau, whole.tau)))
    assert given.files == ("long.csv",)
    assert "15 stretches" in given.notes[0]
