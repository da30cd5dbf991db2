"""Adds references from another topic or file to a table of states; each reference holds until the next one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.data.recording import RawTable
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import LogError


def with_references(
    table: RawTable, source: str, sent: Float[Array, " M"], references: Mapping[str, Float[Array, " M"]]
) -> RawTable:
    """The states, each with the last reference sent before it; states before the first reference are left out.

    Args:
        table: States with a column ``t`` [s].
        source: Topic or file of the references, for messages.
        sent: Time at which each reference was sent [s], on the clock of the states.
        references: Values by name of the column in the table, such as ``q_ref.elbow``, whose place they take.

    Raises:
        LogError: If all states are before the first reference.
    """
    t = table.columns["t"]
    order = np.argsort(sent, kind="stable")
    at = np.searchsorted(sent[order], t, side="right") - 1
    kept = at >= 0
    if not kept.any():
        raise LogError(
            f"{table.file}: all references of {source} came after the last state: record both at the same "
            "time, and by the same clock."
        )
    rows = order[at[kept]]
    columns = {name: values[kept] for name, values in table.columns.items()}
    columns |= {name: values[rows] for name, values in references.items()}
    first = int(np.argmax(kept))
    warning = f"{table.file}: {first} states before the first reference of {source} were left out."
    return replace(
        table,
        columns=columns,
        place=lambda row: table.place(row + first),
        warnings=(*table.warnings, warning) if first else table.warnings,
    )
