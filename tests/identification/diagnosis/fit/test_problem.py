"""Priors of a fitting problem. Oracle: by hand."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.problem import set_up


@pytest.mark.parametrize(("size", "held"), [(1e-12, True), (1e-6, False)])
def test_what_a_motion_shows_by_rounding_alone_is_held_at_zero(quiet, size, held):
    # By hand: the third column of a payload is that of the second, much smaller.
    problem, payload = quiet.problem, quiet.term("payload", None)
    white = problem.white
    values = [[rows.copy() for rows in log] for log in white.values]
    for log in values:
        for row, index in zip(log, white.rows, strict=True):
            place = {column: k for k, column in enumerate(index)}
            if payload.columns[3] in place:
                row[:, place[payload.columns[3]]] = size * row[:, place[payload.columns[1]]]
    small = replace(white, values=tuple(tuple(log) for log in values))
    found = set_up(problem.session, problem.columns, small, problem.weights)
    energy = np.diag(found.grams.everything)[payload.columns[3]]
    assert 0.0 < energy < 1e-5 * np.diag(found.grams.everything)[payload.columns[1]]
    assert (found.precision[payload.columns[3]] == 1.0) == held
