"""Parts whose absence explains inertial parameters. Oracle: the products of Pinocchio's parameters, by hand."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from identification.diagnosis.judge.findings.missing_parts import (
    missing_part_notes,
    missing_shares,
    named_as_part,
    payload_of,
    share_without,
)
from identification.gates.special_case import more_than_a_missing_part
from identification.words.note_words import sentences
from phantom_dyn.model.attached import Attached

PLACE = "identification.diagnosis.judge.findings.missing_parts."
HAND = Attached(("hand", "gripper"), 0.6, np.array([0.0, 0.1, -0.4]), np.diag([0.002, 0.003, 0.004]))
RING = Attached(("ring",), 0.1, np.array([0.0, 0.0, 0.2]), np.diag([1e-4, 1e-4, 2e-4]))


def parameters(part: Attached) -> np.ndarray:
    """Ten parameters of a body, in the order of Pinocchio."""
    return pin.Inertia(part.mass, part.center, part.inertia).toDynamicParameters()


@pytest.fixture
def handed(planar2, rng):
    """Two links with a ring on the first and a hand on the last, and products of their twenty columns."""
    robot = SimpleNamespace(model=planar2.model, attached=((), (RING,), (HAND,)))
    root = rng.normal(size=(30, 40))
    products = SimpleNamespace(session=SimpleNamespace(robot=robot), nuisances=3, total_a=root @ root.T)
    everything = SimpleNamespace(columns=tuple(range(3, 23)))
    return products, everything


@pytest.mark.parametrize("left", [0.0, 0.2])
def test_the_part_is_found_whose_absence_makes_most_of_the_torque(handed, left, rng):
    # By hand: what is left of the squares of the torque when the part is put back.
    problem, term = handed
    rest = left * rng.normal(size=20)
    own = rest - np.concatenate([np.zeros(10), parameters(HAND)])
    share, body, part = share_without(problem, term, own)
    a = problem.total_a[3:23, 3:23]
    assert (body, part) == (2, HAND)
    assert share == pytest.approx(1.0 - (rest @ a @ rest) / (own @ a @ own))


def test_a_part_of_the_first_link_is_found_too(handed):
    problem, term = handed
    share, body, part = share_without(problem, term, np.concatenate([-parameters(RING), np.zeros(10)]))
    assert (share, body, part) == (pytest.approx(1.0), 1, RING)


def test_columns_of_some_links_alone_have_their_own_place(handed):
    problem, _ = handed
    last = SimpleNamespace(columns=tuple(range(13, 23)))
    assert share_without(problem, last, -parameters(HAND))[0] == pytest.approx(1.0)


def test_a_robot_without_such_parts_lacks_none(handed):
    problem, term = handed
    problem.session.robot.attached = ((), (), ())
    assert share_without(problem, term, np.ones(20)) is None
    assert missing_part_notes(problem, term, np.ones(20)) == []


@pytest.mark.parametrize(("share", "said"), [(0.74, False), (0.75, True), (0.994, True)])
def test_a_part_is_told_that_explains_three_quarters(planar2, monkeypatch, share, said):
    monkeypatch.setattr(PLACE + "share_without", lambda *_: (share, 2, HAND))
    words = sentences(missing_part_notes(SimpleNamespace(), SimpleNamespace(joint=None), np.zeros(20)))
    assert len(words) == said
    if said:
        assert words[0].startswith(f"Of what the wrong inertial parameters explain, {round(100 * share)} % is what the")
        assert "without hand and gripper (0.6 kg), which the model carries on a fixed or locked joint" in words[0]


CASES = [(0.89, 2, False), (0.9, 2, True), (0.99, 1, False)]


@pytest.mark.parametrize(("share", "body", "taken"), CASES)
def test_a_payload_says_it_where_nine_tenths_are_a_part_of_its_link(quiet, monkeypatch, share, body, taken):
    monkeypatch.setattr(PLACE + "share_without", lambda *_: (share, body, HAND))
    rich, other = quiet.term("inertial_parameters", None), quiet.term("coulomb_friction", "elbow")
    fitted = SimpleNamespace(coefficients=lambda term: np.zeros(len(term.columns)))
    found = missing_shares(quiet.search, (other, rich), fitted)
    assert {term: not more_than_a_missing_part(part).passed for term, part in found.items()} == {rich: taken}
    assert payload_of(quiet.search) == quiet.term("payload", None)
    assert missing_shares(quiet.search, (other,), fitted) == {}


@pytest.mark.parametrize(("share", "body", "taken"), CASES)
def test_inertial_parameters_that_say_the_same_as_a_payload_are_named(quiet, monkeypatch, share, body, taken):
    monkeypatch.setattr(PLACE + "share_without", lambda *_: (share, body, HAND))
    payload = quiet.term("payload", None)
    found = named_as_part(quiet.search, frozenset([payload]), payload)
    rich = {term.place for term in quiet.search.terms if term.effect.inertial == "free"}
    assert rich
    assert found == (rich if taken else frozenset())
