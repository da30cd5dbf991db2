"""What a diagnosis keeps of recordings. Oracle: weak references to a made recording of two hours."""

from __future__ import annotations

import weakref

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.pipeline import diagnose
from identification.stages import Announcement, Stage


class Enough(Exception):
    """Ends a diagnosis where the test has seen enough."""


def test_a_long_recording_that_the_diagnosis_reads_is_let_go_before_the_first_fit(planar2):
    read: list[weakref.ref[Recording]] = []

    def long(_: bool) -> tuple[Recording, ...]:
        t = np.arange(0.0, 7200.0, 0.05)
        q = np.column_stack([np.sin(t), np.cos(t)])
        whole = Recording("long.csv", planar2.joint_names, t, q, np.ones_like(q))
        read.append(weakref.ref(whole))
        return (whole,)

    def look(told: Announcement) -> None:
        if told.stage is Stage.FILTERING:
            assert read[0]() is None
            raise Enough

    with pytest.raises(Enough):
        diagnose(planar2, long, progress=look)
