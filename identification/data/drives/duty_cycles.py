"""Voltage of motors from the share of the supply that their drives put on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.recording import Table
from phantom_dyn.errors import LogError, listed
from phantom_dyn.motion import read_only

# Share of the supply, at most; a little more is rounding.
_WHOLE = 1.0 + 1e-6


def with_voltages(table: Table) -> Table:
    """The table with ``u.<joint>`` from ``duty.<joint>`` and ``supply`` where the log has no voltage of a joint.

    Args:
        table: Columns under the contract's names.

    Raises:
        LogError: If a duty is no share from -1 to 1.
    """
    duties = {name.partition(".")[2]: values for name, values in table.columns.items() if name.startswith("duty.")}
    for joint, duty in duties.items():
        largest = float(np.max(np.abs(duty), initial=0.0))
        if largest > _WHOLE:
            raise LogError(
                f"{table.file}: duty.{joint} reaches {largest:g}, wanted the share of the supply, -1 to 1: map it with "
                f"its unit, as in duty.{joint}: {{from: duty.{joint}, unit: percent}}."
            )
    lacking = [joint for joint in duties if f"u.{joint}" not in table.columns]
    if not lacking:
        return table
    if "supply" not in table.columns:
        names = listed(f"duty.{joint}" for joint in lacking)
        sentence = f"{table.file}: {names} not used: a voltage from it needs a column supply (voltage of the supply)."
        return replace(table, warnings=(*table.warnings, sentence))
    supply = table.columns["supply"]
    voltages = {f"u.{joint}": read_only(duties[joint] * supply) for joint in lacking}
    return replace(table, columns={**table.columns, **voltages})
