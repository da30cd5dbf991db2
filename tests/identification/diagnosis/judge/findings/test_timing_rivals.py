"""A lag and a delay are separated only where the motion is far above the noise."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.judge.findings.timing_rivals import hidden_twins, strong_motion_loss_increases
from identification.diagnosis.search.rival_sets import compare_with_rivals
from identification.pipeline import diagnose


@pytest.fixture
def late(lab, planar2):
    """A function that makes the search of a recording in which the drive of the elbow lags by some time."""

    def prepared(seconds: float):
        motion = lab.motion(2, 3)
        torque = lab.acting(planar2, motion, "actuator_lag", "elbow", seconds)
        return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))

    return prepared


@pytest.fixture
def beyond(context_of):
    """A function that sums the losses beyond that of an effect on the elbow, by the effects that take its place."""

    def summed(prepared, name):
        term = prepared.term(name, "elbow")
        found = strong_motion_loss_increases(context_of(prepared), frozenset([term]), term, frozenset())
        return {rival.effect_joint: float(loss.sum()) for (rival,), loss in found.items()}

    return summed


@pytest.mark.parametrize(("seconds", "separated"), [(0.1, True), (0.002, False)])
def test_a_lag_is_separated_from_a_delay_if_it_is_not_short(lab, planar2, seconds, separated):
    # Known truth, with 1 + i w T and exp(i w T) for the two laws.
    motion = lab.motion(2, 3)
    torque = lab.acting(planar2, motion, "actuator_lag", "elbow", seconds)
    (found,) = diagnose(planar2, (lab.recording(planar2, motion, torque),)).findings
    assert (found.probability > 0.9) == separated


def test_a_short_lag_and_a_delay_are_one(late, beyond):
    # Closed form: both multiply by 1 + i w T, as long as w T is small.
    assert beyond(late(0.001), "actuator_lag")["input_delay", "elbow"] == 0.0


def test_a_delay_that_leaves_a_gap_beside_a_long_lag_is_compared_at_all_frequencies(late, beyond):
    # Closed form: 1 + i w T and exp(i w T) differ by half where w T is one.
    assert beyond(late(0.3), "actuator_lag") == {}


def test_a_lag_that_adds_nothing_to_a_delay_is_its_rival(late):
    # By the statement: beside a delay a lag may fail a gate that it would pass alone. Friction is no such law, and a
    # delay of all drives makes up for that of another one.
    prepared = late(0.01)
    places = (("actuator_lag", "elbow"), ("actuator_lag", "shoulder"), ("coulomb_friction", "elbow"))
    lag, other_lag, friction = (prepared.term(*place) for place in places)
    delay, delay_of_all = (prepared.term("input_delay", joint) for joint in ("elbow", None))
    found = frozenset([lag, delay, other_lag, friction, delay_of_all])
    assert hidden_twins(found, frozenset([delay])) == {lag}
    assert hidden_twins(found, frozenset([friction])) == frozenset()


def test_friction_is_compared_with_its_rivals_at_all_frequencies(late, beyond):
    assert beyond(late(0.06), "coulomb_friction") == {}


@pytest.mark.parametrize(("more", "probability"), [(0.0, 0.5), (100.0, 1.0)])
def test_losses_on_a_part_of_the_data_replace_those_of_the_whole_search(late, more, probability):
    # By hand: two sets that tie share the probability, and one that is far worse has none.
    prepared = late(0.06)
    lag, delay = (prepared.term(name, "elbow") for name in ("actuator_lag", "input_delay"))
    search, chosen = prepared.search, frozenset([lag])
    loss = np.full(len(search.held_out_fit(chosen).loss), more)
    compared = compare_with_rivals(
        replace(search, terms=(lag, delay)), chosen, lag, partial_losses={frozenset([delay]): loss}
    )
    assert compared.probability == pytest.approx(probability)
