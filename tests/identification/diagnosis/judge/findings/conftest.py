from collections.abc import Callable

import numpy as np
import pytest

from identification.diagnosis.judge.findings.bench import Bench, Residuals
from identification.diagnosis.judge.judged_band import Judge, plain_search
from lab import Prepared


@pytest.fixture(scope="session")
def bench_of() -> Callable[[Prepared], Bench]:
    """A function that makes a bench in whose judged band noise is next to nothing."""

    def made(prepared: Prepared) -> Bench:
        plain = plain_search(prepared.search, prepared.noise)
        tiny = np.full(2, 1e-9)
        judge = Judge(plain.problem, tiny, tiny)
        residuals = Residuals(lambda _: judge, lambda *_: np.full_like(tiny, np.inf), lambda _: True)
        return Bench(prepared.search, plain, prepared.noise, residuals)

    return made
