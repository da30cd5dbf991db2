"""Libraries that only some uses need. Oracle: ``pyproject.toml``."""

from __future__ import annotations

import numpy
import pytest

from phantom_dyn import libraries
from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import is_installed, missing_library, optional_library


def test_a_missing_library_is_named_with_the_command_that_installs_it():
    assert missing_library("rosbags") == (
        "Reading a ROS bag or MCAP needs rosbags, which is not installed: pip install 'phantom-dyn[ros]'."
    )


def test_what_can_be_imported_is_installed():
    assert (is_installed("numpy"), is_installed("no_such_library")) == (True, False)


def test_an_optional_library_is_the_module_itself():
    assert optional_library("numpy") is numpy


def test_an_optional_library_that_is_missing_is_refused_in_that_sentence(monkeypatch):
    monkeypatch.setattr(libraries, "is_installed", lambda _: False)
    with pytest.raises(UsageError, match=r"A table of findings.* needs pandas.* 'phantom-dyn\[tables\]'"):
        optional_library("pandas")
