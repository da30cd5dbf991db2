"""What compiled loops over samples take and what they refuse."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn._kernels import rigid_body
from phantom_dyn._kernels.tree_arrays import tree_arrays
from phantom_dyn.errors import ParameterError

SAMPLES = 7


def strided(x: np.ndarray) -> np.ndarray:
    return np.repeat(x, 2, axis=0)[::2]


OTHER_LAYOUTS = {
    "strided": strided,
    "Fortran order": np.asfortranarray,
    "backwards": lambda x: x[::-1].copy()[::-1],
    "big-endian": lambda x: x.astype(">f8"),
    "read-only": lambda x: np.frombuffer(x.tobytes()).reshape(x.shape),
}


@pytest.mark.parametrize("layout", OTHER_LAYOUTS)
def test_samples_in_another_layout_give_the_same(layout, rng):
    model = load_robot("example:ur10").model
    samples, arrays = rng.normal(size=(3, SAMPLES, 6)), tree_arrays(model)
    other = [OTHER_LAYOUTS[layout](x) for x in samples]
    np.testing.assert_array_equal(
        rigid_body.regressor(model, arrays, *other), rigid_body.regressor(model, arrays, *samples)
    )
    np.testing.assert_array_equal(rigid_body.torque(model, arrays, *other), rigid_body.torque(model, arrays, *samples))
    np.testing.assert_array_equal(rigid_body.mass(model, arrays, other[0]), rigid_body.mass(model, arrays, samples[0]))


@pytest.mark.parametrize("kind", [np.int64, np.float32, bool])
def test_whole_numbers_give_what_the_same_floats_give(kind, rng):
    model = load_robot("example:ur10").model
    samples, arrays = rng.integers(0, 2, size=(3, SAMPLES, 6)), tree_arrays(model)
    found = rigid_body.regressor(model, arrays, *samples.astype(kind))
    np.testing.assert_array_equal(found, rigid_body.regressor(model, arrays, *samples.astype(float)))
    # No machine code of its own for every kind of number.
    assert len(getattr(rigid_body.regressor_loop, "signatures", ())) <= 2


@pytest.mark.parametrize("columns", [(3, 2), (4, 4), (-1, 3), (10,), (1.5,)])
def test_columns_that_do_not_ascend_or_do_not_exist_are_refused(columns):
    # At the kernel: the type checker of the tests stops a fraction before the public function.
    model, still = load_robot("emps").model, np.zeros((1, 1))
    with pytest.raises(ParameterError, match="give ascending column numbers from 0 to 9"):
        rigid_body.regressor(model, tree_arrays(model), still, still, still, columns=columns)


@pytest.mark.parametrize(
    "out",
    [np.zeros((3, 1, 9)), np.zeros((2, 1, 10)), np.zeros((3, 1, 10), np.float32), np.zeros((3, 1, 20))[:, :, ::2]],
)
def test_room_that_does_not_fit_is_refused(out):
    model, still = load_robot("emps").model, np.zeros((3, 1))
    with pytest.raises(ParameterError, match=r"give a C-contiguous array of floats .*of shape \(3, 1, 10\)"):
        rigid_body.regressor(model, tree_arrays(model), still, still, still, out=out)


def test_the_first_use_says_what_it_waits_for(caplog):
    class Loop:
        signatures = ()

    with caplog.at_level(logging.INFO, "phantom_dyn"):
        rigid_body.announce(Loop())  # type: ignore[arg-type]
    assert "Preparing compiled loops over samples" in caplog.text
