"""Count which second recordings distinguish the rivals for each make, and compare them in pairs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import bootstrap

from benchmarks.gapbench.scoring.proportions import proportion

CHOICES = ("proposed", "random", "D-optimal")
Row = dict


def paired_difference(one: Sequence[bool], other: Sequence[bool]) -> tuple[float, tuple[float, float] | None]:
    """Share of cases that one motion decides minus that of another, with its 95 % bootstrap interval.

    The interval is None for a single case or without a difference: resampling cannot tell how rare a difference is that
    never occurred.
    """
    differences = np.array(one, dtype=float) - np.array(other, dtype=float)
    if not differences.any() or len(differences) < 2:
        return float(differences.mean()), None
    drawn = bootstrap((differences,), np.mean, method="percentile", rng=np.random.default_rng(20261))
    low, high = (float(x) for x in drawn.confidence_interval)
    return float(differences.mean()), (low, high)


def lines_of(title: str, rows: Sequence[Row], opened: int, best_of: int) -> list[str]:
    """Results of one make, or of all makes.

    Args:
        title: Name of the make.
        rows: Cases whose findings and rivals include the truth and other effects.
        opened: Number of cases that were diagnosed.
        best_of: Number of random motions that were tried for undecided cases.
    """
    asked = [row for row in rows if row["proposed"] is not None]
    out = [
        f"{title}: {len(rows)} of {opened} cases leave a set that holds the truth; a motion is proposed for "
        f"{len(asked)}, none for the others."
    ]
    for name in CHOICES if asked else ():
        rivals, sure = (100 * np.mean([row[key][name] for row in asked]) for key in ("struck", "sure"))
        out.append(
            f"{name:>10}: the truth alone in {sum(row[name] for row in asked)} of {len(asked)}, "
            f"{rivals:.0f} % of the rivals struck off, probability of the truth {sure:.0f} %"
        )
    for name in CHOICES[1:] if asked else ():
        value, interval = paired_difference([row["proposed"] for row in asked], [row[name] for row in asked])
        words = "no interval" if interval is None else f"{100 * interval[0]:.0f} to {100 * interval[1]:.0f}"
        out.append(f"  proposed less {name}: {100 * value:.0f} points ({words})")
    whole = [row for row in asked if not row["left"]]
    if whole:
        out.append(
            f"  where all rivals were said to be separated: in {sum(row['proposed'] for row in whole)} of {len(whole)} "
            f"({sum(row['expected'] for row in whole):.1f} expected), by the random motion in "
            f"{sum(row['random'] for row in whole)}"
        )
    if best_of:
        out += _tried_words(rows, best_of)
    return out


def _tried_words(rows: Sequence[Row], best_of: int) -> list[str]:
    out = []
    for words, some in (
        ("Where the proposed motion does not decide", [row for row in rows if row["proposed"] is False]),
        ("Where none is proposed", [row for row in rows if row["proposed"] is None]),
    ):
        tried = [row for row in some if "any" in row]
        if tried:
            hits = proportion(row["any"] is not None for row in tried)
            out.append(f"  {words}, one of {best_of} random ones does on two noises in {hits.hits} of {hits.total}.")
    return out


def table_of(rows: Sequence[Row], opened: dict[str, int], best_of: int) -> str:
    """Results of each make, and of all makes together."""
    out = []
    for make, count in opened.items():
        out += lines_of(make, [row for row in rows if row["make"] == make], count, best_of)
    if len(opened) > 1:
        out += lines_of("all", rows, sum(opened.values()), best_of)
    return "\n".join(out)
