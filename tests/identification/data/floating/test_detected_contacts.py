"""Contacts that no column states. Oracle: the stances that were put into a log of known truth."""

from dataclasses import replace

import numpy as np
import pytest

from floating_leg import log_of_leg, written_leg
from identification.data.floating.detected_contacts import with_detected_contacts
from identification.data.reading import recording
from identification.data.recording import Table
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot


def without_contacts(folder, rng, *, steps):
    """The recording of a leg whose log states no contacts, and the stances that were put in."""
    file = written_leg(folder)
    robot, log = load_robot(file), log_of_leg(file, rng, steps=steps)
    stands = log.pop("contact.foot")
    return recording(Table("log.csv", log), robot), robot, stands > 0.5


def test_every_stance_is_within_a_detected_contact(tmp_path, rng):
    found, _, stands = without_contacts(tmp_path, rng, steps=True)
    (touches,) = found.base.contacts.values()
    assert np.all(touches[stands] == 1.0)
    # With margins on both sides of five stances in six seconds.
    assert touches.mean() < stands.mean() + 0.25
    assert "contacts were detected from torques" in found.warnings[-1]


def test_a_leg_that_hangs_touches_nothing(tmp_path, rng):
    found, _, _ = without_contacts(tmp_path, rng, steps=False)
    (touches,) = found.base.contacts.values()
    assert not touches.any()


def test_contacts_that_are_stated_stay(tmp_path, rng):
    file = written_leg(tmp_path)
    log = log_of_leg(file, rng, steps=True)
    found = recording(Table("log.csv", log), load_robot(file))
    assert np.array_equal(found.base.contacts["foot"], log["contact.foot"])
    assert not any("detected" in sentence for sentence in found.warnings)


def test_without_torques_nothing_can_be_detected(tmp_path, rng):
    found, robot, _ = without_contacts(tmp_path, rng, steps=True)
    nothing = replace(found, tau=None, base=replace(found.base, contacts={}))
    with pytest.raises(
        LogError, match=r"neither a column contact\.<frame> nor torques .*0 throughout if the robot hangs"
    ):
        with_detected_contacts(nothing, robot)
