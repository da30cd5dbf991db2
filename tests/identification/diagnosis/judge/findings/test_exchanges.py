"""What gave way to rivals is asked again where one of these falls. Oracle: the sets, written by hand."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from identification.diagnosis.judge.findings.bench import Shown, State
from identification.diagnosis.judge.findings.shown import _without_exchanges
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.rival_sets import Standing


@pytest.fixture
def place(quiet):
    """A term of the planar arm by effect and joint."""
    return lambda effect, joint: next(
        term for term in quiet.search.terms if (term.effect.name, term.joint) == (effect, joint)
    )


@pytest.fixture
def exchanged(place, quiet):
    """Viscous friction gave way to a coupling and a spring together."""
    gone = frozenset([place("viscous_friction", "elbow")])
    rivals = frozenset([place("joint_coupling", "shoulder+elbow"), place("parasitic_spring", "elbow")])
    state = State(rivals, rivals, outdone=frozenset(term.place for term in gone), exchanged=((gone, rivals),))
    return SimpleNamespace(record=quiet.search.record.forked()), state, gone, rivals


def test_it_is_back_where_one_of_the_rivals_falls(exchanged):
    bench, before, gone, rivals = exchanged
    fallen = min(rivals, key=lambda term: term.effect.name)
    after = _without_exchanges(bench, before, replace(before, shown=rivals - {fallen}))
    assert (after.found, after.shown) == (gone, gone)
    assert after.barred == {fallen.place}
    assert after.outdone == frozenset()


def test_it_stays_away_while_all_of_them_are_there(exchanged):
    bench, before, _, _ = exchanged
    assert _without_exchanges(bench, before, before) is before


def test_it_stays_away_where_something_simpler_takes_the_place(exchanged, place):
    bench, before, _, rivals = exchanged
    simpler = frozenset([place("torque_offset", "elbow")])
    after = replace(before, shown=(rivals - {place("parasitic_spring", "elbow")}) | simpler)
    assert _without_exchanges(bench, before, after) is after


@pytest.mark.parametrize(("spring", "offset", "back"), [(0.6, 0.1, True), (0.4, 0.5, False)])
def test_it_is_back_beside_the_only_rival_that_falls_if_no_other_is_likelier(exchanged, place, spring, offset, back):
    bench, before, gone, _ = exchanged
    rival = frozenset([place("parasitic_spring", "elbow")])
    likelier = (
        Rival((EffectAt("parasitic_spring", "elbow"),), spring),
        Rival((EffectAt("torque_offset", "elbow"),), offset),
    )
    standing = Standing(1.0 - spring - offset, likelier)
    shown = Shown(None, gone, None, dict.fromkeys(gone, standing))
    # What fails to be shown by motion is hidden, and still found.
    before = replace(before, found=rival, shown=rival, exchanged=((gone, rival),), looked_at=(shown,))
    after = _without_exchanges(bench, before, replace(before, shown=frozenset()))
    assert after.shown == (gone if back else frozenset())
    assert after.barred == frozenset()
    # It may not take the place of what is back once more.
    assert ({term.place for term in rival} <= after.outdone) is back
