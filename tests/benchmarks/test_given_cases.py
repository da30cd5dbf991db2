"""Scores of cases with answers, and verdicts that their own figures contradict. Oracle: counted by hand."""

import json

import pytest

from benchmarks.blind.contradictions import contradiction
from benchmarks.given_cases import answered, figures


def joint(after: float, within: float = 10.0, highest: float = 1.1) -> dict:
    return {
        "joint": "j1",
        "rms_before": within,
        "rms_within_tolerance": within,
        "rms_after": after,
        "noise_floor": 1.0,
        "noise_floor_interval": [0.9, highest],
    }


def said(verdict: str, *findings: tuple[str, str], after: float = 1.0, times=(), structured=False, left=0.0) -> dict:
    return {
        "verdict": verdict,
        "findings": [{"effect": effect, "joint": at, "rivals": []} for effect, at in findings],
        "joints": [joint(after)],
        "unexplained": {
            "structured": structured,
            "fraction_of_explainable": left,
            "where": {"joint": None, "regime": None, "times": list(times)},
        },
    }


COULOMB = ("coulomb_friction", "j1")


@pytest.mark.parametrize(
    ("diagnosis", "wrong"),
    [
        (said("no_gap"), None),
        (said("no_gap", after=1.2), "no_gap, and j1 is above its noise floor"),
        (said("no_gap", times=[[1.0, 2.0]]), "no_gap, and something acts at 1 times"),
        (said("no_gap", structured=True), "no_gap, with findings or structure"),
        (
            said("no_gap") | {"rollout": {"strays": {"j1": 2.1}}},
            "no_gap, and j1 strays further than noise makes it in simulation",
        ),
        (said("no_gap") | {"rollout": {"strays": {"j1": 1.9}}}, None),
        (said("explained", COULOMB, after=3.2), None),
        (said("explained", COULOMB, after=3.4), "explained, and j1 has much left"),
        (said("explained", COULOMB, structured=True, left=0.1), "explained, with structure of weight left"),
        (said("unknown", after=9.0, structured=True, left=0.9), None),
    ],
)
def test_a_verdict_is_borne_out_by_its_figures_or_not(diagnosis, wrong):
    assert contradiction(diagnosis) == wrong


@pytest.fixture
def case(tmp_path):
    def made(name: str, diagnosis: dict | None, *effects: tuple[str, str], floors: float = 5.0):
        folder = tmp_path / name
        folder.mkdir()
        listed = [{"effect": effect, "joint": at, "accept": []} for effect, at in effects]
        (folder / "answer.json").write_text(json.dumps({"effects": listed, "gap_over_floor": floors}))
        return answered(folder, diagnosis)

    return made


def test_every_figure_counts_its_own_cases(case):
    # By hand: a null right and one with a claim; a single named, one missed and one too small to count; and a push.
    cases = [
        case("a", said("no_gap"), floors=0.0),
        case("b", said("explained", COULOMB), floors=0.0),
        case("c", said("explained", COULOMB), COULOMB),
        case("d", said("no_gap", after=2.0), ("torque_saturation", "j1")),
        case("e", said("no_gap"), COULOMB, floors=1.0),
        case("f", said("unknown", times=[[1.0, 1.5]]), ("push", "j1")),
        case("g", None, ("shaker", "j1")),
    ]
    lines = {line[:30].strip(): line[30:].strip() for line in figures(cases)}
    assert lines == {
        "false claims on nulls": "1 of 2",
        "no_gap on nulls": "1 of 2",
        "leading effect right": "1 of 2",
        "true effect listed": "1 of 2",
        "hidden, and no wrong claim": "1 of 1",
        "both of a pair": "0 of 0",
        "unknown outside": "1 of 2",
        "saturation named": "0 of 1",
        "pushes named or unknown": "1 of 1",
        "times of events without any": "0 of 6",
        "contradictory verdicts": "1 of 7",
    }
