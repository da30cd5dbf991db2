from __future__ import annotations

import numpy as np

from identification.next_experiment.proposal_words import reference_text
from phantom_dyn.motion import Motion


def test_a_reference_has_the_columns_of_the_contract_and_loses_no_digit(rng):
    q, v, a = rng.normal(size=(3, 5, 2))
    text = reference_text(Motion(np.arange(5) / 3.0, q, v, a), ("j1", "j2"))
    header, *rows = text.splitlines()
    assert header == "t,q_ref.j1,q_ref.j2,v_ref.j1,v_ref.j2,a_ref.j1,a_ref.j2"
    table = np.array([[float(x) for x in row.split(",")] for row in rows])
    np.testing.assert_array_equal(table, np.column_stack([np.arange(5) / 3.0, q, v, a]))
