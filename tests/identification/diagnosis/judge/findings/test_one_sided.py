# pyright: reportAttributeAccessIssue=false
"""Intervals of bodies on the edge of what can exist. Oracles: the edge itself, and a body well inside of it."""

from types import SimpleNamespace
from typing import cast

from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.joint_fit import joint_fit
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.findings.findings import one_sided
from identification.words.notes_on_findings import FINDING_WORDS


def shown_on(lab, robot, torque_of) -> Shown:
    """Inertial parameters of the elbow, found in a recording with a torque beyond the model."""
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    prepared = lab.prepared(robot, (lab.recording(robot, motion, torque_of(motion)),))
    term = next(t for t in prepared.columns.terms if t.place == ("inertial_parameters", "elbow"))
    found = fit(prepared.problem, (term,))
    fitted = joint_fit(prepared.problem, (term,), found)
    return cast(Shown, SimpleNamespace(problem=prepared.problem, joint_fit=fitted, named=frozenset([term])))


def test_a_body_on_the_edge_has_an_interval_to_one_side(lab, planar2):
    inertia = float(planar2.model.inertias[2].toDynamicParameters()[6])
    # More inertia is missing than the elbow has.
    shown = shown_on(lab, planar2, lambda motion: 30.0 * inertia * motion.a * [0.0, 1.0])
    (note,) = one_sided(shown)
    assert note.joint == "elbow"
    (mass,) = [part for part in note.numbers["intervals"] if part[0] == "elbow.m"]
    # No link weighs less than nothing.
    assert -float(planar2.model.inertias[2].mass) <= mass[1] < mass[2]
    assert "to one side" in FINDING_WORDS[note.code](note)


def test_a_heavier_link_that_exists_has_none(lab, planar2):
    def heavier(motion):
        return lab.acting(planar2, motion, "payload", None, 0.3, 0.1, 0.0, -0.2)

    assert one_sided(shown_on(lab, planar2, heavier)) == ()
