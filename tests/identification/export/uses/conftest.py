"""Made-up diagnoses of the planar arm."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from identification.diagnosis.result import Bound, Diagnosis, Finding, Value


def finding(effect: str, joint: str | None, loadings: tuple = (), **parameters: Value) -> Finding:
    return Finding(effect, joint, "everywhere", dict(parameters), 0.5, (0.4, 0.6), 0.9, (), "supported", None, loadings)


@pytest.fixture(scope="session")
def made() -> Callable[..., Finding]:
    """A finding from effect, joint, loadings and parameters."""
    return finding


@pytest.fixture(scope="session")
def diagnosed(made_up) -> Callable[..., Diagnosis]:
    """A diagnosis of the arm with some findings and bounds."""

    def make(*findings: Finding, bounds: tuple[Bound, ...] = (), period: float | None = 0.005) -> Diagnosis:
        plain = made_up(("shoulder", "elbow"), samples=400)
        evidence = replace(plain.evidence, sample_period=period)
        return replace(plain, findings=findings, bounds=bounds, evidence=evidence)

    return make
