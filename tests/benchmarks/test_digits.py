"""What digits change: oracle is NumPy's own reading, and diagnoses that the test writes."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.digits import Answer, answer_of, differences, written

FRICTION, SPRING = ("coulomb_friction", "j1"), ("parasitic_spring", "j1")


@pytest.mark.parametrize(("digits", "apart"), [(17, 0.0), (9, 5.1e-10), (7, 5.1e-8)])
@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_a_log_has_the_digits_that_were_asked_for(tmp_path, rng, digits, apart, kind):
    q = rng.uniform(0.1, 1.0, 50)
    np.savez(tmp_path / "log.npz", **{"t": np.arange(50.0), "q.j1": q})
    written(tmp_path / "log.npz", 17, tmp_path / "log.csv")
    written(tmp_path / f"log.{kind}", digits, tmp_path / "copy.csv")
    assert (tmp_path / "copy.csv").read_text().startswith("t,q.j1\n")
    error = np.abs(np.loadtxt(tmp_path / "copy.csv", delimiter=",", skiprows=1)[:, 1] - q).max()
    assert apart / 5 <= error <= apart


def test_another_finding_is_a_difference_and_a_rival_is_named_as_one():
    whole = Answer("explained", frozenset([FRICTION]), frozenset([SPRING]), 0.9)
    other = Answer("explained", frozenset([SPRING]), frozenset([FRICTION]), 0.9)
    assert differences({17: whole, 9: whole, 7: whole}) == []
    (line,) = differences({17: whole, 9: other})
    assert line.startswith("9 digits: explained, parasitic_spring j1")
    assert line.endswith("(rivals of each other)")
    (line,) = differences({17: whole, 9: Answer("unknown")})
    assert not line.endswith("(rivals of each other)")


def test_a_refusal_is_no_answer():
    assert answer_of(None).verdict == "failed"
