"""The oracle is the contract's schema, written again as strict structures."""

import dataclasses
import json
import math

import msgspec
import numpy as np
import pytest

from diagnosis_schema import Document, Law, Rollout
from identification.diagnosis import residual_law as results
from identification.diagnosis.result import Unexplained, Value
from identification.reporting.stored.diagnosis_files import json_text, to_json


@pytest.fixture
def made_up(made_up):
    """A made-up diagnosis that a run has signed, as every one in a file is."""
    return lambda **given: dataclasses.replace(made_up(**given), run="0123456789abcdef")


@pytest.mark.parametrize("findings", [0, 1, 15])
def test_the_text_has_the_contracts_fields_and_types(made_up, findings):
    text = json_text(made_up(findings=findings))
    assert len(msgspec.json.decode(text, type=Document).findings) == findings


def test_next_experiment_and_rollout_keep_their_shape(made_up):
    diagnosis = dataclasses.replace(
        made_up(),
        next_experiment={"separates": [("backlash", "j1"), ("payload", None)], "reference": "next.csv",
                         "expected_power": np.float64(0.97), "say": "Move slowly."},
        rollout={"horizon_s": 0.5, "rms_before": {"j1": np.float32(0.5)}, "rms_after": {"j1": math.nan}},
    )  # fmt: skip
    document = msgspec.json.decode(json_text(diagnosis), type=Document)
    assert document.rollout == Rollout(0.5, {"j1": 0.5}, {"j1": None})


def test_fields_stand_in_the_contracts_order(made_up):
    assert tuple(to_json(made_up())) == Document.__struct_fields__


def test_where_is_nested_in_unexplained(made_up):
    rest = Unexplained(0.4, True, "j2", "low_speed", ((1.0, 1.5),))
    assert to_json(dataclasses.replace(made_up(), unexplained=rest))["unexplained"] == {
        "fraction_of_explainable": 0.4,
        "structured": True,
        "where": {"joint": "j2", "regime": "low_speed", "times": [[1.0, 1.5]]},
        "law": None,
    }


def test_a_law_has_the_contracts_fields(made_up):
    law = results.Law("j2", ("v.j2", "t"), "-2*sign(v)", 0.7, (0.6, 0.8), {"t": (0.0, 9.0)}, None)
    rest = Unexplained(0.4, True, "j2", "low_speed", law=law)
    document = msgspec.json.decode(json_text(dataclasses.replace(made_up(), unexplained=rest)), type=Document)
    assert document.unexplained.law == Law("j2", ["v.j2", "t"], "-2*sign(v)", 0.7, (0.6, 0.8), {"t": (0.0, 9.0)}, None)


def test_a_rival_is_a_list_of_effects_and_a_probability(made_up):
    assert to_json(made_up(findings=2))["findings"][1]["rivals"] == [
        {
            "effects": [
                {"effect": "presliding_friction", "joint": "j2"},
                {"effect": "torque_offset", "joint": "j2"},
            ],
            "probability": 0.07,
        }
    ]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, np.float64("nan")])
def test_a_number_that_is_not_finite_is_null(made_up, bad):
    rest = Unexplained(bad, False, None, None)
    assert to_json(dataclasses.replace(made_up(), unexplained=rest))["unexplained"]["fraction_of_explainable"] is None


def test_nothing_is_rounded(made_up):
    third = dataclasses.replace(made_up().findings[0], parameters={"torque": Value(1 / 3, 1e-300, "N m")})
    document = json.loads(json_text(dataclasses.replace(made_up(), findings=(third,))))
    assert document["findings"][0]["parameters"]["torque"]["value"] == 1 / 3


def test_a_value_of_another_kind_is_refused(made_up):
    with pytest.raises(TypeError, match="holds no set"):
        to_json(dataclasses.replace(made_up(), rollout={"joints": {1, 2}}))
