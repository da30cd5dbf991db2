"""What becomes of a function where numba is absent, or has nowhere to keep its machine code."""

from __future__ import annotations

import numba
import pytest

from phantom_dyn.kernels import jit


def twice(x: float) -> float:
    return 2 * x


@pytest.mark.parametrize("decorator", [jit.jit, jit.fused, jit.inlined])
def test_without_numba_a_function_stays_itself(decorator, monkeypatch):
    monkeypatch.setattr(jit, "njit", None)
    assert decorator(twice) is twice


def test_a_function_is_compiled_where_no_folder_can_be_written_to(monkeypatch):
    # Numba's own words there; the oracle is the function itself.
    def njit(cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function 'twice': no locator available for file")
        return numba.njit(**options)

    monkeypatch.setattr(jit, "njit", njit)
    assert jit.jit(twice)(1.5) == twice(1.5)
