"""Torque constants of the page on formats; oracle: torque over current as the maker states them, and the reader."""

from __future__ import annotations

import re

import pytest

from phantom_dyn import load_robot
from places import CHECKOUT

PAGE = (CHECKOUT / "docs" / "how_to" / "formats.md").read_text()
ROWS = re.findall(r"^\| (\S+) \| ([\d.]+) N m, ([\d.]+) A \([\d.]+ V\) \| ([\d.]+) \|$", PAGE, flags=re.MULTILINE)


def test_each_constant_is_torque_over_current():
    assert len(ROWS) == 10
    for _, torque, current, constant in ROWS:
        assert float(constant) == pytest.approx(float(torque) / float(current), rel=5e-3)


def test_the_constants_of_the_ur10_are_read_as_torque_at_the_joint(tmp_path):
    (block,) = re.findall(r"```yaml\n(joints:\n  shoulder_pan_joint.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "robot.yaml").write_text(block)
    arm = load_robot("example:ur10", config=tmp_path / "robot.yaml")
    found = [(one.torque_constant or 0.0) * one.gear_ratio for one in arm.actuators]
    assert found == [13.5841, 14.2959, 11.3716, 11.2408, 11.7681, 11.7682]
