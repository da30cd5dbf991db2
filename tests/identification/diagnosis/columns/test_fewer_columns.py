import numpy as np
import pytest

from identification.diagnosis.columns.fewer_columns import columns_for
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.problem import set_up


@pytest.mark.parametrize("names", [(), ("coulomb_friction",), ("torque_constant", "viscous_friction", "payload")])
def test_a_set_of_effects_is_fitted_with_its_own_columns_as_with_all(quiet, names):
    # Oracle: the fit beside all columns, held out too; weights and white noise are those of all columns.
    terms = tuple(quiet.term(name, None if name == "payload" else "elbow") for name in names)
    problem = quiet.problem
    few, there = columns_for(problem.columns, frozenset(terms))
    white, _ = columns_for(problem.white, frozenset(terms))
    assert len(few.names) < len(problem.columns.names)
    small = set_up(problem.session, few, white, problem.weights)
    wanted, found = fit(problem, terms), fit(small, tuple(there[term] for term in terms))
    assert found.total == pytest.approx(wanted.total, rel=1e-9)
    assert [few.names[k] for k in found.active] == [problem.columns.names[k] for k in wanted.active]
    np.testing.assert_allclose(found.theta[found.active], wanted.theta[wanted.active], rtol=1e-6, atol=1e-9)
    # What says which columns a row has agrees with what is in it.
    assert [part.shape[1] for part in few.values[0]] == [len(row) for row in few.rows]
