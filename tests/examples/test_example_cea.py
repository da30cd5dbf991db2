"""The example of the CEA branch, held against the published values that it prints."""

from __future__ import annotations

import re

import pytest

from called_example import printed
from phantom_dyn.devices.cea import FRICTION_TESTS

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def out() -> str:
    return printed("identify_cea.py")


def test_it_prints_the_known_rank(out):
    assert "cea_branch: 21 of 60 inertial parameters" in out


def test_it_prints_the_regrouping_of_joint_5(out):
    # Known: MX5R = MX5 + d6 M6 - (d6 / d3) MX6.
    assert "link5.mxR = link5.mx + 0.08 link6.m - 0.2 link6.mx" in out


def test_friction_is_within_three_deviations_of_test_t1(out):
    # Known truth: what Table 3 gives for t1, in all tests, as the passive joints are free.
    rows = re.findall(r"^  ((?:FV|FC)[25])(t\d) +([\d.]+) \+- ([\d.]+)", out, flags=re.MULTILINE)
    assert len(rows) == 8
    for name, _, value, std in rows:
        assert abs(float(value) - FRICTION_TESTS[f"{name}t1"].value) < 3 * float(std) + 1e-4


def test_the_stiffness_is_the_published_one(out):
    found = re.search(r"^  K ([\d.]+) \+- ", out, flags=re.MULTILINE)
    assert found
    assert float(found[1]) == pytest.approx(2.0, rel=0.004)


def test_all_16_parameters_stand_beside_table_4(out):
    rows = re.findall(r"^\w+ +(-?[\d.]+) \+- ([\d.]+) .* Table 4 +(-?[\d.]+)", out, flags=re.MULTILINE)
    assert len(rows) == 16
    assert all(abs(float(value) - float(truth)) < 3.5 * float(std) for value, std, truth in rows)


def test_the_cross_test_error_of_each_axis_is_printed(out):
    assert re.search(r"unseen motion: q1 [\d.]+ %, q2 [\d.]+ %, q5 [\d.]+ %", out)


def test_the_spread_over_link_lengths_is_printed(out):
    # Known: only links of 0.35 m and more come to 0.4 N or less.
    forces = re.findall(r"d3 ([\d.]+) m, d4 .*: [\d.]+ kg, ([\d.]+) N", out)
    assert len(forces) == 6
    assert [float(force) <= 0.40 for _, force in forces] == [float(d3) >= 0.35 for d3, _ in forces]
