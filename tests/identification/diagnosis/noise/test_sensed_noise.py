"""Noise drawn from what the sensors make. Oracle: the deviation that was put in."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.noise.sensor_floor import sensed_noise


def test_what_the_model_was_found_wrong_by_is_drawn_beside_the_sensors(lab, planar2):
    motion = lab.motion(2, 3, seconds=20.0)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, np.zeros_like(motion.q)),))
    session, columns = prepared.session, prepared.columns
    wrong = replace(session, robot=replace(session.robot, model_error=np.array([[0.0, 0.0], [0.5, 0.5]])))
    unpredicted = tuple(np.full(part.shape, 1e3) for part in columns.residual)
    (plain,), (drawn,) = (sensed_noise(one, columns, unpredicted) for one in (session, wrong))
    use = columns.usable[0][:, 1]
    assert np.array_equal(plain[:, 0], drawn[:, 0])
    assert (drawn - plain)[use, 1].std() == pytest.approx(0.5, rel=0.2)
