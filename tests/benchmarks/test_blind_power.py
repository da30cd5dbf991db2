"""Bounds against sealed cases: which effect is put in, how large, and what counts as seen."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind.power import ONE_NUMBER, check, chosen_bound, effect_of, found, recorded, report, setup_of
from benchmarks.gapbench.generator.effects import WHOLE

PENDULUM = 702  # its robot is the quickest to move

# A diagnosis that says what this test wants: no gap and one bound where the torque is small, a finding where it is not.
STUB = """
import csv, json, pathlib, sys
rows = list(csv.reader(open("log.csv")))[1:]
mean = abs(sum(float(r[-1]) for r in rows) / len(rows))
bound = {"effect": "torque_offset", "joint": "j1", "parameter": "torque", "below": 1.0, "unit": "N m"}
finding = {"effect": "coulomb_friction", "joint": "j1", "rivals":
           [{"effects": [{"effect": "torque_offset", "joint": "j1"}], "probability": 0.4}]}
said = {"verdict": "no_gap", "findings": [], "bounds": [bound]}
if mean > 0.8:
    said = {"verdict": "explained", "findings": [finding], "bounds": []}
pathlib.Path(sys.argv[sys.argv.index("--json") + 1]).write_text(json.dumps(said))
"""


def bound(effect: str, joint: str | None, below: float = 0.1) -> dict:
    return {"effect": effect, "joint": joint, "parameter": "x", "below": below, "unit": ""}


def test_effects_take_turns_by_the_seed():
    bounds = [bound(effect, "j1") for effect in ONE_NUMBER]
    chosen = [chosen_bound(bounds, seed) for seed in range(len(ONE_NUMBER))]
    assert [b["effect"] for b in chosen if b] == list(ONE_NUMBER)


def test_joints_take_turns_after_the_effects():
    bounds = [bound("viscous_friction", joint) for joint in ("j2", "j1")]
    chosen = [chosen_bound(bounds, seed) for seed in (0, len(ONE_NUMBER))]
    assert [b["joint"] for b in chosen if b] == ["j1", "j2"]


def test_an_effect_of_several_numbers_is_not_put_in():
    assert chosen_bound([bound("payload", None), bound("cogging", "j1")], 0) is None


@pytest.mark.parametrize(
    ("effect", "joint", "index", "value"), [("viscous_friction", "j2", 1, 0.1), ("torque_constant", "j1", 0, 1.1)]
)
def test_a_bound_becomes_the_effect_of_that_size(effect, joint, index, value):
    owner = SimpleNamespace(links=[SimpleNamespace(joint="j1"), SimpleNamespace(joint="j2")])
    made = effect_of(bound(effect, joint), SimpleNamespace(owner=owner))  # pyright: ignore[reportArgumentType]
    assert (made.effect, made.joint, made.parameters["x"]) == (effect, index, pytest.approx(value))


def test_an_effect_of_the_whole_robot_has_no_joint():
    made = effect_of(bound("input_delay", None), SimpleNamespace(owner=SimpleNamespace(links=[])))  # pyright: ignore
    assert made.joint == WHOLE


def diagnosis(*names: str, verdict: str = "explained", rivals: tuple[str, ...] = ()) -> dict:
    listed = [{"effects": [{"effect": name, "joint": "j1"}], "probability": 0.1} for name in rivals]
    return {"verdict": verdict, "findings": [{"effect": n, "joint": "j1", "rivals": listed} for n in names]}


@pytest.mark.parametrize(
    ("said", "seen", "listed"),
    [
        (diagnosis("viscous_friction"), True, True),
        (diagnosis("coulomb_friction"), True, False),
        (diagnosis("coulomb_friction", rivals=("viscous_friction",)), True, True),
        (diagnosis(verdict="unknown"), True, False),
        (diagnosis(verdict="no_gap"), False, False),
        (None, False, False),
    ],
)
def test_what_counts_as_seen_and_as_listed(said, seen, listed):
    x = found(bound("viscous_friction", "j1"), said)
    assert (x.seen, x.listed) == (seen, listed)


def test_the_report_counts_in_all_and_by_effect():
    outcomes = [found(bound("viscous_friction", "j1"), diagnosis("viscous_friction")) for _ in range(3)]
    outcomes.append(found(bound("backlash", "j1"), diagnosis(verdict="no_gap")))
    text = report(outcomes)
    assert "| all                 | 4     | 75 % (30 to 95)" in text
    assert "| backlash            | 1     | 0 % (0 to 79)" in text


def test_a_seed_is_recorded_twice_with_the_same_motion_and_noise(tmp_path):
    """Known truth: an offset of 1 N m is the difference in mean torque, but for gravity where the joint shifts."""
    stub = tmp_path / "stub.py"
    stub.write_text(STUB)
    outcomes = check(range(PENDULUM, PENDULUM + 1), tmp_path, 1, [sys.executable, str(stub)])
    assert [(x.effect, x.seen, x.listed) for x in outcomes] == [("torque_offset", True, True)]
    without, with_effect = (
        np.genfromtxt(tmp_path / "cases" / f"p{PENDULUM:05d}{x}" / "log.csv", delimiter=",", names=True) for x in "ab"
    )
    assert abs(np.mean(with_effect["tauj1"] - without["tauj1"])) == pytest.approx(1.0, rel=0.1)
    assert json.loads((tmp_path / "answers" / f"p{PENDULUM:05d}b.json").read_text())["bound"]["below"] == 1.0


def test_the_case_of_a_setup_tells_nothing_of_an_effect():
    drawn = setup_of(PENDULUM)
    assert drawn is not None
    case = recorded("p", *drawn)
    assert case.answer == {}
    assert case.header == ("t", "q.j1", "tau.j1")
