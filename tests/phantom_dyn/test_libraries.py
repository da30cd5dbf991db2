"""Libraries that only some uses need. Oracle: ``pyproject.toml``."""

from __future__ import annotations

from phantom_dyn.libraries import is_installed, missing_library


def test_a_missing_library_is_named_with_the_command_that_installs_it():
    assert missing_library("rosbags") == (
        "Reading a ROS bag or MCAP needs rosbags, which is not installed: pip install 'phantom-dyn[ros]'."
    )


def test_what_can_be_imported_is_installed():
    assert (is_installed("numpy"), is_installed("no_such_library")) == (True, False)
