"""The command why. Oracle: the words of the ledger, and the contract (exit code 2 with one sentence for bad input)."""

from __future__ import annotations

import json

import pytest

from identification.cli.main import main
from identification.reporting.stored.diagnosis_files import json_text
from identification.words.ledger_words import listed, why
from made_up_diagnosis import made_up_diagnosis


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json_text(made_up_diagnosis()))
    return path


@pytest.mark.parametrize("joint", [None, "j2"])
def test_it_prints_why_an_effect_is_not_named(file, capsys, joint):
    words = ["why", str(file.parent), "torque_offset", *([] if joint is None else ["--joint", joint])]
    assert main(words) == 0
    assert capsys.readouterr().out == listed(why(made_up_diagnosis(), "torque_offset", joint)) + "\n"


def test_a_diagnosis_without_a_ledger_is_read_and_refused_in_one_sentence(file, capsys):
    content = json.loads(file.read_text())
    del content["ledger"]
    file.write_text(json.dumps(content))
    assert main(["why", str(file), "payload"]) == 0  # a bound says something of it
    assert "would have shown it from mass 0.03 kg on" in capsys.readouterr().out
    assert main(["why", str(file), "cogging"]) == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    assert "holds no ledger" in sentence


def test_an_effect_that_there_is_not_is_bad_input(file, capsys):
    assert main(["why", str(file), "rust"]) == 2
    assert "'rust' was asked for, which is no effect that this diagnosis looked at" in capsys.readouterr().err


def test_a_file_that_is_missing_is_bad_input(tmp_path, capsys):
    assert main(["why", str(tmp_path / "none.json"), "payload"]) == 2
    assert capsys.readouterr().out == ""
