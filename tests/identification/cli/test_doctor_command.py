"""``phantom-dyn doctor``. Oracle: importlib.metadata, and pip's own names."""

from __future__ import annotations

from importlib import metadata

import pytest

from identification.cli import doctor_command
from identification.cli.doctor_command import required
from identification.cli.main import main
from phantom_dyn import __version__


def test_versions_are_those_that_are_installed(capsys):
    assert main(["doctor"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["phantom-dyn", __version__] in lines
    assert ["numpy", metadata.version("numpy")] in lines


def test_a_missing_extra_is_named_with_the_command_that_installs_it(monkeypatch, capsys):
    real = doctor_command.version_of
    monkeypatch.setattr(doctor_command, "version_of", lambda name: None if name == "rosbags" else real(name))
    main(["doctor"])
    said = " ".join(capsys.readouterr().out.split())
    assert "rosbags missing: pip install 'phantom-dyn[ros]' reading a ROS bag or MCAP" in said
    assert "Nothing that every use needs is missing." in said


def test_a_missing_library_of_the_base_is_told_at_the_end(monkeypatch, capsys):
    monkeypatch.setattr(doctor_command, "version_of", lambda name: None if name == "numpy" else "1.0")
    main(["doctor"])
    assert (
        capsys.readouterr()
        .out.rstrip()
        .endswith("Missing: numpy. Install phantom-dyn again: pip install --force-reinstall phantom-dyn")
    )


@pytest.mark.parametrize(
    ("requirement", "names"),
    [("numpy<3,>=2.0", ("numpy",)), ("rosbags<0.12; extra == 'ros'", ()), ("coal", ("coal",))],
)
def test_only_what_every_use_needs_is_required(requirement, names):
    assert required([requirement]) == names
