"""Damaged ``diagnosis.json``. Oracle: the contract's kinds of value; a good file is one that we wrote."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from identification.reporting.stored.diagnosis_files import json_text
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from phantom_dyn.errors import LogError


@pytest.fixture
def refused(made_up, tmp_path) -> Callable[..., str]:
    """Reads a good file after a change, which must be refused in one sentence."""

    def read(change: Callable[[dict[str, Any]], object]) -> str:
        content = json.loads(json_text(made_up()))
        path = tmp_path / "diagnosis.json"
        path.write_text(json.dumps(content))
        assert read_diagnosis(path).verdict == content["verdict"]
        change(content)
        path.write_text(json.dumps(content))
        with pytest.raises(LogError) as refusal:
            read_diagnosis(path)
        assert str(refusal.value).startswith(str(path))
        assert str(refusal.value).endswith("diagnose the recording again.")
        return str(refusal.value)

    return read


def test_a_text_for_a_number(refused):
    told = refused(lambda content: content["joints"][0].update(rms_before="much"))
    assert "Expected float" in told
    assert "$.joints[0].rms_before" in told


def test_a_list_for_a_name(refused):
    assert "$.findings[0].joint" in refused(lambda content: content["findings"][0].update(joint=["j1"]))


def test_a_number_too_large_for_a_float(refused):
    assert "gap_closed" in refused(lambda content: content["findings"][0].update(gap_closed=10**400))


def test_a_number_whose_square_is_too_large(refused):
    assert "gap_closed" in refused(lambda content: content["findings"][0].update(gap_closed=1e300))


def test_an_outcome_that_there_is_not(refused):
    assert "$.ledger[0].outcome" in refused(lambda content: content["ledger"][0].update(outcome="perhaps"))


def test_a_file_without_a_ledger_is_read(made_up, tmp_path):
    content = json.loads(json_text(made_up()))
    del content["ledger"]
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(content))
    assert read_diagnosis(path).ledger == ()


def test_an_unknown_key(refused):
    assert "more" in refused(lambda content: content.update(more=1))


def test_fewer_deviations_than_values(refused):
    def change(content: dict[str, Any]) -> None:
        value = next(iter(content["findings"][0]["parameters"].values()))
        value.update(value=[1.0, 2.0], std=[0.1])

    assert "has not as many deviations as values" in refused(change)


def test_lists_in_one_another_without_end(tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text("[" * 100_000)
    with pytest.raises(LogError, match=r"is no JSON .*: give a diagnosis\.json"):
        read_diagnosis(path)
