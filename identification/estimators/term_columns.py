"""Which columns of the equations belong to which effect."""

from __future__ import annotations

from identification.regressor import Regressor


def term_columns(regressor: Regressor) -> tuple[tuple[int, ...], ...]:
    """Columns of each term, in the order of the terms.

    Args:
        regressor: Its columns stand in the order of its terms, each named after its own.
    """
    out, at = [], regressor.first_effect
    for term in regressor.terms:
        start = at
        while at < len(regressor.names) and regressor.names[at].startswith(f"{term.label}."):
            at += 1
        out.append(tuple(range(start, at)))
    return tuple(out)
