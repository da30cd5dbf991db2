"""Bare and loaded, with a weak model. Oracle: known loads on an arm whose links and friction are not the model's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.changes import Change, KnownPayload, with_payload
from identification.notes import Code, Note
from identification.pipeline import diagnose
from identification.scenarios.one_difference import judged_by_difference, model_in_common
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_friction, with_parameters
from phantom_dyn.errors import LogError

# Whole diagnoses: what they call is checked beside the functions.
pytestmark = pytest.mark.whole

LOAD = KnownPayload(0.8, (0.05, 0.0, -0.3))
CHANGES = (Change("bare.csv"), Change("loaded.csv", changed=("payload",)))


@pytest.fixture(scope="module")
def truly(planar2):
    """The arm with links 30 % heavier than modelled, and three times the friction."""
    heavier = with_parameters(planar2, 0.3 * standard_parameters(planar2))
    for row, joint in enumerate(planar2.joint_names):
        more = {"viscous": 2.0 * planar2.viscous_friction[row], "coulomb": 2.0 * planar2.coulomb_friction[row]}
        heavier = with_friction(heavier, joint, **more)
    return heavier


@pytest.fixture(scope="module")
def recordings(lab, truly, recorded):
    def both(load):
        robots = truly, truly if load is None else with_payload(truly, load)
        motions = (lab.motion(2, seed, seconds=20.0, swing=1.5) for seed in (3, 4))
        pairs = zip(robots, motions, CHANGES, strict=True)
        return tuple(recorded(robot, motion, 0.0, change.file, k) for k, (robot, motion, change) in enumerate(pairs))

    return both


def test_the_model_in_common_needs_the_torques_of_the_true_arm(planar2, truly, recordings, lab):
    found, offsets, note = model_in_common(planar2, recordings(LOAD), CHANGES)
    motion = lab.motion(2, 9, seconds=5.0, swing=1.2)
    wanted = inverse_dynamics(truly, motion)
    off = np.sqrt(np.mean((inverse_dynamics(found, motion) - wanted) ** 2, axis=0))
    assert np.all(off < 0.02 * np.sqrt(np.mean(wanted**2, axis=0)))
    assert all(abs(one.theta[0]) < 0.05 for one in offsets)
    assert note == Note(Code.MODEL_IN_COMMON, None, {"files": ["bare.csv"]})


def test_a_load_is_found_beside_a_weak_model(planar2, recordings):
    found = diagnose(planar2, recordings(LOAD), changes=CHANGES)
    (payload,) = (one for one in found.findings if one.effect == "payload")
    assert payload.recording == "loaded.csv"
    mass = payload.parameters["mass"]
    assert isinstance(mass.value, float)
    assert isinstance(mass.std, float)
    assert abs(mass.value - LOAD.mass) < 3 * mass.std < 0.3 * LOAD.mass
    assert found.verdict == "explained"


def test_no_load_is_found_where_none_was_added(planar2, recordings):
    found = diagnose(planar2, recordings(None), changes=CHANGES)
    assert [one.effect for one in found.findings if one.recording is not None] == []


def test_only_a_load_without_a_value_is_judged_by_its_difference():
    assert judged_by_difference(CHANGES)
    assert not judged_by_difference((CHANGES[0], replace(CHANGES[1], payload=LOAD)))
    assert not judged_by_difference((CHANGES[0], replace(CHANGES[1], changed=("friction",))))


def test_a_load_in_every_recording_leaves_nothing_to_compare_with(planar2, recordings):
    both = tuple(replace(one, changed=("payload",)) for one in CHANGES)
    with pytest.raises(LogError, match="every recording carries a load without a value"):
        model_in_common(planar2, recordings(LOAD), both)
