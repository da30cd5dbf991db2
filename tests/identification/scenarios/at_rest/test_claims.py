"""The ledger of recordings at rest. Known truth: a play or a spring that was simulated; oracle: the findings."""

from __future__ import annotations

import numpy as np
import pytest

from identification.scenarios.at_rest.diagnose_at_rest import claims_at_rest
from identification.scenarios.at_rest.giving_way import GivingWay, giving_way
from identification.scenarios.at_rest.rests import Stills
from identification.words.ledger_words import REASONS

PLAY, SPRING = ("backlash",), ("transmission_compliance",)
BOTH = (*PLAY, *SPRING)


def way(rng: np.random.Generator, gap: float = 0.0, compliance: float = 0.0, sizes: float = 1.0) -> GivingWay:
    """What forty rests under loads of either sign say; they repeat to a tenth of a milliradian."""
    load = np.tile([1.0, -1.0], 20) * (1.0 + sizes * np.repeat(np.arange(20), 2) / 10.0)
    error = -0.5 * gap * np.sign(load) - compliance * load + 1e-4 * rng.standard_normal(40)
    rest = np.arange(40)
    return giving_way(Stills(rest.astype(float), load[:, None], error, load, rest, 0.0))


def outcomes(found: GivingWay) -> dict[tuple[str, ...], str]:
    claims = claims_at_rest("pin", found, 1e-4)
    for claim in claims:
        passed = [result.passed for result in claim.gates]
        assert passed == [True] * len(passed) if claim.outcome == "claimed" else passed[-1] is False
        assert {result.gate for result in claim.gates} <= REASONS.keys()
        assert claim.judged_by == "rests"
    return {tuple(at.effect for at in claim.effects): claim.outcome for claim in claims}


def test_a_play_is_claimed_and_a_spring_gives_way_to_it(rng):
    assert outcomes(way(rng, gap=0.01)) == {PLAY: "claimed", SPRING: "displaced", BOTH: "not_claimed"}


def test_a_spring_is_claimed_and_a_play_gives_way_to_it(rng):
    assert outcomes(way(rng, compliance=0.005)) == {SPRING: "claimed", PLAY: "displaced", BOTH: "not_claimed"}


def test_play_and_spring_are_claimed_where_each_is_sure_beside_the_other(rng):
    found = way(rng, gap=0.01, compliance=0.005)
    assert outcomes(found) == {PLAY: "claimed", SPRING: "claimed"}
    (first, _) = claims_at_rest("pin", found, 1e-4)
    assert [result.gate for result in first.gates] == ["more than chance", "both are there", "likelier than rivals"]


def test_a_joint_that_does_not_give_way_fails_the_gate_of_chance(rng):
    found = way(rng)
    assert set(outcomes(found).values()) == {"not_claimed"}
    (gate,) = {claim.gates for claim in claims_at_rest("pin", found, 1e-4)}
    assert [result.gate for result in gate] == ["more than chance"]


def test_loads_of_one_size_do_not_separate_the_two(rng):
    found = way(rng, gap=0.01, sizes=0.0)
    assert outcomes(found) == {PLAY: "claimed", SPRING: "displaced"}
    assert [claim.gates[-1].value for claim in claims_at_rest("pin", found, 1e-4)] == [0.5, 0.5]


def test_a_claim_closes_what_its_finding_closes(rng):
    found = way(rng, gap=0.01)
    (claim, *_) = claims_at_rest("pin", found, 1e-4)
    assert claim.figures["closes"] == pytest.approx(1.0, abs=0.01)
