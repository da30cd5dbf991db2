"""The least value of a smooth function of one variable between two bounds.

`scipy.optimize` has the same; importing it takes longer than a diagnosis looks for cogging. It is the oracle of the
tests. Source: Brent, Algorithms for Minimization without Derivatives (1973), chapter 5.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_GOLDEN = 0.5 * (3.0 - 5.0**0.5)
_MOST = 100  # evaluations; some ten are usual


def bounded_minimum(function: Callable[[float], float], low: float, high: float, near: float) -> float:
    """Where a function is least between two bounds, to within ``near``: by parabolas, or by golden sections.

    Of a function with several minima it is one of them.
    """
    a, b = low, high
    # The best point, the second best, and the one before that.
    best = second = third = a + _GOLDEN * (b - a)
    at_best = at_second = at_third = function(best)
    step = before = 0.0
    for _ in range(_MOST):
        middle = 0.5 * (a + b)
        least = float(np.sqrt(np.finfo(float).eps)) * abs(best) + near / 3.0
        if abs(best - middle) <= 2.0 * least - 0.5 * (b - a):
            break
        r = (best - second) * (at_best - at_third)
        q = (best - third) * (at_best - at_second)
        p, q = (best - third) * q - (best - second) * r, 2.0 * (q - r)
        p, q = (-p, q) if q > 0.0 else (p, -q)
        before, last = step, before
        if abs(last) > least and abs(p) < abs(0.5 * q * last) and q * (a - best) < p < q * (b - best):
            step = p / q
            if min(best + step - a, b - best - step) < 2.0 * least:
                step = least if middle >= best else -least
        else:
            before = (a if best >= middle else b) - best
            step = _GOLDEN * before
        there = best + (step if abs(step) >= least else (least if step >= 0.0 else -least))
        value = function(there)
        if value <= at_best:
            a, b = (best, b) if there >= best else (a, best)
            third, second, best = second, best, there
            at_third, at_second, at_best = at_second, at_best, value
            continue
        a, b = (there, b) if there < best else (a, there)
        if value <= at_second or second == best:
            third, second, at_third, at_second = second, there, at_second, value
        elif value <= at_third or third in (best, second):
            third, at_third = there, value
    return best
