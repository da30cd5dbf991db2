from collections.abc import Callable

import numpy as np
import pytest

from identification.diagnosis.judge.findings.gate_state import GateContext, Residuals
from identification.diagnosis.judge.judged_band import JudgedBand, plain_search
from lab import Prepared


@pytest.fixture(scope="session")
def context_of() -> Callable[[Prepared], GateContext]:
    """A function that makes the context of the gates, with next to no noise in the judged band."""

    def made(prepared: Prepared) -> GateContext:
        plain = plain_search(prepared.search, prepared.noise)
        tiny = np.full(2, 1e-9)
        judged = JudgedBand(plain.problem, tiny, tiny)
        residuals = Residuals(lambda _: judged, lambda *_: np.full_like(tiny, np.inf), lambda _: True)
        return GateContext(prepared.search, plain, prepared.noise, residuals)

    return made
