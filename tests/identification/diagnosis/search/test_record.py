"""What is written down of decisions. Oracle: by hand."""

from identification.diagnosis.search.record import Record
from identification.engine.claims import GateResult

LOW, HIGH = GateResult("gain", 1.0, 2.0, "1", False), GateResult("gain", 3.0, 2.0, "1", True)
LASTING = GateResult("lasting", 5.0, 2.0, "1", True)


def test_the_last_result_of_a_gate_counts(quiet):
    record, term = Record(), quiet.term("coulomb_friction", "elbow")
    record.kept([term], HIGH, LASTING)
    record.lost([term], LOW)
    assert record.met(term.place) == (LOW, LASTING)


def test_what_comes_back_has_failed_nothing_and_nothing_is_in_its_place(quiet):
    record = Record()
    term, other = quiet.term("coulomb_friction", "elbow"), quiet.term("viscous_friction", "elbow")
    record.lost([term], LOW, instead=[other])
    assert record.instead(term.place) == (other.place,)
    record.kept([term], LASTING)
    assert record.met(term.place) == (LASTING,)
    assert record.instead(term.place) == ()


def test_a_trial_changes_nothing_before_it_is_taken(quiet):
    record, term = Record(), quiet.term("coulomb_friction", "elbow")
    trial = record.forked()
    trial.kept([term], HIGH)
    assert record.places == ()
    record.take(trial)
    assert record.places == (term.place,)


def test_a_structure_without_a_name_is_no_claim(quiet):
    record, nameless = Record(), next(term for term in quiet.search.terms if not term.named)
    record.kept([nameless], HIGH)
    assert record.places == ()
