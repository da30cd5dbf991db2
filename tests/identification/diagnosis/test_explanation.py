"""The search and the noise in turn: what chance gives is measured by the filters that the problem was made white by."""

from itertools import count

import numpy as np

from identification.diagnosis import explanation
from identification.diagnosis.search.search import Threshold


def test_chance_is_measured_by_the_filters_of_the_problem_after_a_second_effect_on_probation(lab, planar2, monkeypatch):
    # Known truth: the problem is set up once, so that its columns are white by the first noise to the end.
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -0.2 * np.sign(motion.v)),))
    effects = [prepared.term("coulomb_friction", joint) for joint in ("shoulder", "elbow")]
    tries, filtered_by = count(1), []
    filters_of = explanation.whitening_of

    def recorded(columns, noise):
        filtered_by.append(noise)
        return filters_of(columns, noise)

    def best_short(*_):
        tried = next(tries)
        return frozenset(effects[:tried]) if tried <= len(effects) else None

    monkeypatch.setattr(explanation, "whitening_of", recorded)
    monkeypatch.setattr(explanation, "best_short", best_short)
    monkeypatch.setattr(explanation, "explain", lambda search, progress, start=frozenset(): start)
    monkeypatch.setattr(explanation, "smaller_noise", lambda *_: (tuple(0.9 * x for x in prepared.noise), 0.9))
    monkeypatch.setattr(explanation, "null_threshold", lambda *_: Threshold(1.0, {}))
    monkeypatch.setattr(explanation, "claimed", lambda *_: True)
    found = explanation._searched(prepared.search, prepared.noise, lambda _: None)
    assert found.chosen == frozenset(effects)
    assert [noise is prepared.noise for noise in filtered_by] == [True, True]
