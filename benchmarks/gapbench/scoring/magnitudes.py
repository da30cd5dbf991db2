"""How far the parameters of right findings are from the truth."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, pi, remainder

COUNTED = ("order",)  # whole numbers: an interval of zero width says nothing
ANGLES = ("phase",)
Z95 = 1.959963984540054


def _listed(value: object) -> list[float]:
    """A number or a list of numbers as a list; anything else as an empty one."""
    values = value if isinstance(value, list) else [value]
    numbers = [float(x) for x in values if isinstance(x, int | float)]
    return numbers if len(numbers) == len(values) else []


def magnitudes(truth: Sequence[dict], findings: Sequence[dict]) -> tuple[tuple[float, ...], tuple[bool, ...]]:
    """Relative errors and coverage of the parameters whose finding names effect and joint as the truth does.

    An angle's error is relative to half a turn. Parameters that the diagnosis words differently are left out.
    """
    errors, covered = [], []
    for effect in truth:
        for finding in findings:
            if (finding["effect"], finding["joint"]) != (effect["effect"], effect["joint"]):
                continue
            for name, given in effect["parameters"].items():
                said = finding["parameters"].get(name)
                if said is None or name in COUNTED:
                    continue
                true, value, std = _listed(given), _listed(said["value"]), _listed(said["std"])
                if not len(true) == len(value) == len(std):
                    continue
                for t, x, s in zip(true, value, std, strict=True):
                    miss = abs(remainder(x - t, 2.0 * pi)) if name in ANGLES else abs(x - t)
                    covered.append(isfinite(miss) and miss <= Z95 * s)
                    scale = pi if name in ANGLES else abs(t)
                    if scale:
                        errors.append(miss / scale)
    return tuple(errors), tuple(covered)
