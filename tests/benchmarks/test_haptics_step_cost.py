"""The table of processor time per control step. Oracles: the rates of the paper, and its list of effects."""

from __future__ import annotations

import re

import numpy as np
import pytest

from benchmarks import haptics_step_cost


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(haptics_step_cost, "CYCLES", 200)


def test_cycles_are_apart_as_in_the_paper(short):
    steps, q, asked = haptics_step_cost.motion(np.random.default_rng(0))
    assert 1 / 2000 <= steps.min() < steps.max() <= 1 / 500
    assert q.shape == asked.shape == (6, 200)


@pytest.mark.whole
def test_each_degradation_of_the_paper_has_its_medians(short, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["haptics_step_cost.py"])
    haptics_step_cost.main()
    rows = re.findall(r"^\| ([a-z ]+) \| ([\d.]+) \| (\d+) \|$", capsys.readouterr().out, flags=re.MULTILINE)
    names = ["nothing", "saturation", "cogging", "friction", "inertia", "inertia and backlash", "all"]
    assert [row[0] for row in rows] == names
    # A call from Python checks and packs its arguments: it costs more than the same cycle inside the loop.
    assert all(0 < float(inside) < float(outside) for _, inside, outside in rows)
