"""The example of an effect of one's own. Oracle: the size that it puts in."""

from __future__ import annotations

import importlib

import pytest

import phantom_dyn as dyn
from called_example import EXAMPLES

pytestmark = pytest.mark.whole


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module("own_effect")


def test_it_is_at_most_forty_lines():
    assert len((EXAMPLES / "own_effect.py").read_text().splitlines()) <= 40


@pytest.mark.nightly
def test_it_finds_nothing_where_nothing_is_and_the_size_that_was_put_in(example, monkeypatch):
    found, diagnose = [], dyn.diagnose

    def kept(*arguments, **options):
        found.append(diagnose(*arguments, **options))
        return found[-1]

    monkeypatch.setattr(dyn, "diagnose", kept)
    example.main()
    none, some = found
    assert (none.verdict, none.findings) == ("no_gap", ())
    (finding,) = some.findings
    size = finding.parameters["coefficient"]
    assert (some.verdict, finding.effect, finding.joint) == ("explained", "bellows", "axis")
    assert abs(size.value - 50.0) < 2.0 * size.std < 1.0
