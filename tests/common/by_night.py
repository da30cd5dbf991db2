"""Cases that `make test` leaves to `make nightly`, where one of them already fails for the same mistake."""

from collections.abc import Iterable
from typing import Any

import pytest


def by_night(cases: Iterable[Any], *soon: int) -> list[Any]:
    """Cases of a parametrised test, all nightly but those at the places ``soon``; a tuple is a value for each name."""
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=() if k in soon else pytest.mark.nightly)
        for k, case in enumerate(cases)
    ]
