"""Sizes that no sound robot has. Oracles: by hand, and recorded torques and speeds."""

import numpy as np
import pytest

from identification.diagnosis.search.plausible_sizes import RANGES, implausible


@pytest.mark.parametrize(("excess", "ratio"), [(9.0 / 4.0, 4.0 / 13.0), (-0.2, None), (0.9, None), (-0.6, 2.5)])
def test_a_torque_constant_is_plausible_between_a_half_and_two(quiet, excess, ratio):
    fault = implausible(quiet.session, quiet.term("torque_constant", "elbow"), np.array([excess]))
    assert (None if fault is None else fault[1]) == (ratio if ratio is None else pytest.approx(ratio))


@pytest.mark.parametrize(("effect", "by_speed"), [("coulomb_friction", False), ("viscous_friction", True)])
def test_no_drive_moves_a_joint_against_twice_the_torque_that_it_ever_gave(quiet, effect, by_speed):
    # By hand: twice the largest torque of the elbow, for viscous friction over its largest speed.
    (log,) = quiet.session.logs
    most = 2.0 * np.abs(log.tau[:, 1]).max() / (np.abs(log.motion.v[:, 1]).max() if by_speed else 1.0)
    term = quiet.term(effect, "elbow")
    assert implausible(quiet.session, term, np.array([0.99 * most])) is None
    fault = implausible(quiet.session, term, np.array([1.01 * most]))
    assert fault is not None
    parameter, value = fault
    assert parameter.plausible is not None
    assert parameter.plausible[1] == pytest.approx(most)
    assert value == pytest.approx(1.01 * most)


def test_what_is_no_friction_has_no_range_by_the_recorded_torque(quiet):
    # A spring may hold more than the drive does.
    term = quiet.term("torque_offset", "elbow")
    assert implausible(quiet.session, term, np.array([5.0 * quiet.session.largest_torque[1]])) is None


def test_each_range_says_why():
    assert all(one.because and one.most > 0.0 for one in RANGES)
