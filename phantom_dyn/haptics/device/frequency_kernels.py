"""Compiled frequency analysis of a sampled loop: discretisation, frequency response, gains at the stability limit.

The functions have no annotations, because numba compiles them for the types of their arguments. The equations are in
`phantom_dyn.haptics.device.discretisation`. A system is ``A (n, n)``, ``B (n,)``, ``C (n,)``. A ``loop`` is the result
of `SampledAxis.loop`: whole periods of delay, both feed-throughs, and the results of `loop_polynomials`.
"""

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit

# Number of terms of the Taylor series; its remainder is below 1e-17 at norm 0.5.
_TERMS = 14
# Points of the frequency grid per decade.
_A_DECADE = 150
# Points of the grid around each lightly damped mode, in units of its half width.
_AROUND = np.tan(np.linspace(-1.5, 1.5, 25))
# Largest change of phase by delay and hold between two points of the grid [rad].
_TURN = 0.2
# Bisection steps for the frequency of a crossing, which determine it to the last bits.
_HALVINGS = 60


@jit
def _product(a, b):
    """Product of two square matrices; it compiles much faster than ``@``, and runs faster for four rows."""
    n = a.shape[0]
    out = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            for j in range(n):
                out[i, j] += a[i, k] * b[k, j]
    return out


@jit
def held_input(A, B, duration):
    """Exact transition matrix of the state over ``duration`` [s], and the state that a constant unit input adds.

    Both are computed by scaling and squaring of the Taylor series.
    """
    n = A.shape[0]
    norm = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(A[i, j]) * duration
        norm = max(norm, row)
    # Only A enters the norm, because the input column may have any size.
    scale = 1.0
    halvings = 0
    while norm * scale > 0.5:
        scale *= 0.5
        halvings += 1
    wide = np.zeros((n + 1, n + 1))
    total = np.zeros((n + 1, n + 1))
    term = np.zeros((n + 1, n + 1))
    for i in range(n + 1):
        total[i, i] = term[i, i] = 1.0
    for i in range(n):
        wide[i, n] = B[i] * duration * scale
        for j in range(n):
            wide[i, j] = A[i, j] * duration * scale
    for k in range(1, _TERMS + 1):
        term = _product(term, wide)
        for i in range(n + 1):
            for j in range(n + 1):
                term[i, j] /= k
                total[i, j] += term[i, j]
    for _ in range(halvings):
        total = _product(total, total)
    return total[:n, :n].copy(), total[:n, n].copy()


@jit
def delayed_input(A, B, period, rest):
    """Transition matrix of the state over a period [s], and the states that a newer and an older unit input add.

    The older input acts during the first ``rest`` seconds of the period, the newer one after that.
    """
    late, newer = held_input(A, B, period - rest)
    older = np.zeros(len(B))
    if rest == 0.0:
        return late, newer, older
    early, first = held_input(A, B, rest)
    for i in range(len(B)):
        for j in range(len(B)):
            older[i] += late[i, j] * first[j]
    return _product(late, early), newer, older


@jit
def loop_polynomials(transition, newer, older, C):
    """Denominator of the sampled system and its numerators for newer and older input, in falling powers of ``z - 1``.

    They are computed by the method of Faddeev and LeVerrier from the transition matrix minus one. Polynomials in z
    would lose digits by cancellation near z = 1, where the crossings at low frequencies are.
    """
    n = transition.shape[0]
    step = transition.copy()
    adjugate = np.zeros((n, n))
    for i in range(n):
        step[i, i] -= 1.0
        adjugate[i, i] = 1.0
    denominator = np.zeros(n + 1)
    denominator[0] = 1.0
    of_newer = np.zeros(n)
    of_older = np.zeros(n)
    for k in range(n):
        for i in range(n):
            for j in range(n):
                of_newer[k] += C[i] * adjugate[i, j] * newer[j]
                of_older[k] += C[i] * adjugate[i, j] * older[j]
        adjugate = _product(step, adjugate)
        trace = 0.0
        for i in range(n):
            trace += adjugate[i, i]
        denominator[k + 1] = -trace / (k + 1)
        for i in range(n):
            adjugate[i, i] += denominator[k + 1]
    return denominator, of_newer, of_older


@jit
def inverse_loop(w, period, steps, direct_now, direct_before, denominator, of_newer, of_older):
    """One over the sampled open loop at ``w`` [rad/s]; the arguments after ``period`` are the parts of a ``loop``."""
    x = w * period
    delta = complex(-2.0 * np.sin(0.5 * x) ** 2, np.sin(x))
    back = complex(np.cos(x), -np.sin(x))
    low = 0j
    for c in denominator:
        low = low * delta + c
    newer = 0j
    for c in of_newer:
        newer = newer * delta + c
    older = 0j
    for c in of_older:
        older = older * delta + c
    high = newer + older * back + (direct_now + direct_before * back) * low
    return low / high * complex(np.cos(steps * x), np.sin(steps * x))


@jit
def gain_on_axis(w, period, loop, scaled, fixed):
    """The complex gain g for which ``1 + (g scaled + fixed) L = 0``; it is real where the loop crosses the real axis.

    ``scaled`` and ``fixed`` are controllers, each given by its coefficients of ``1`` and of ``1/z``.
    """
    back = complex(np.cos(w * period), -np.sin(w * period))
    steps, direct_now, direct_before, denominator, of_newer, of_older = loop
    inverse = inverse_loop(w, period, steps, direct_now, direct_before, denominator, of_newer, of_older)
    return -(inverse + fixed[0] + fixed[1] * back) / (scaled[0] + scaled[1] * back)


@jit
def frequency_grid(low, period, delay, modes):
    """Increasing frequencies [rad/s] from ``low`` to just below the Nyquist frequency.

    The grid is the union of three: frequencies with evenly spaced logarithms; evenly spaced frequencies, so close that
    the delay changes the phase only a little between two of them; and frequencies around each mode (frequency and half
    width, shape ``(m, 2)``).
    """
    high = np.pi / period * (1.0 - 1e-9)
    low = min(low, 0.1 * high)
    many = int(np.ceil(np.log10(high / low) * _A_DECADE)) + 1
    even = int(np.ceil(np.pi / period * (delay + period) / _TURN)) + 1
    grid = np.empty(many + even + len(modes) * len(_AROUND))
    for k in range(many):
        grid[k] = low * (high / low) ** (k / (many - 1))
    for k in range(even):
        grid[many + k] = low + (high - low) * (k + 1) / even
    at = many + even
    for m in range(len(modes)):
        for offset in _AROUND:
            grid[at] = min(max(modes[m, 0] + offset * modes[m, 1], low), high)
            at += 1
    return np.sort(grid)


@jit
def crossings(grid, period, loop, scaled, fixed):
    """Frequencies [rad/s] at which `gain_on_axis` is real, and its values there; the last is the Nyquist frequency."""
    found = np.empty((len(grid) + 1, 2))
    count = 0
    value = gain_on_axis(grid[0], period, loop, scaled, fixed)
    for k in range(1, len(grid)):
        following = gain_on_axis(grid[k], period, loop, scaled, fixed)
        if (value.imag < 0.0) != (following.imag < 0.0):
            a, b, sign = grid[k - 1], grid[k], value.imag < 0.0
            for _ in range(_HALVINGS):
                middle = 0.5 * (a + b)
                if (gain_on_axis(middle, period, loop, scaled, fixed).imag < 0.0) == sign:
                    a = middle
                else:
                    b = middle
            gain = gain_on_axis(0.5 * (a + b), period, loop, scaled, fixed)
            # At an undamped anti-resonance the gain changes its sign through infinity, which is not a crossing.
            if abs(gain) < 1e3 * (abs(value) + abs(following)):
                found[count] = 0.5 * (a + b), gain.real
                count += 1
        value = following
    nyquist = np.pi / period
    found[count] = nyquist, gain_on_axis(nyquist, period, loop, scaled, fixed).real
    return found[: count + 1]


@jit
def lowest_gain(low, modes, period, delay, loop, virtual_damping):
    """Critical stiffness and its frequency, as in `phantom_dyn.haptics.stability.critical_stiffness`.

    The device must be stable without a wall. Then no eigenvalues are needed: soft walls are stable if the damping at
    the lowest frequency is positive and no limit of stability is between 0 and the virtual damping.
    """
    grid = frequency_grid(low, period, delay, modes)
    rate = virtual_damping / period
    spring = (1.0, 0.0)
    fixed = (rate, -rate)
    if gain_on_axis(grid[0], period, loop, spring, fixed).imag >= 0.0:
        return 0.0, np.nan
    if virtual_damping != 0.0:
        for limit in crossings(grid, period, loop, (1.0 / period, -1.0 / period), (0.0, 0.0))[:, 1]:
            if (0.0 < limit <= virtual_damping) or (virtual_damping <= limit < 0.0):
                return 0.0, np.nan
    best, at = np.inf, np.nan
    for w, gain in crossings(grid, period, loop, spring, fixed):
        if 0.0 < gain < best:
            best, at = gain, w
    return best, at


class MapDevices(NamedTuple):
    """State spaces and modes of the devices of a map, one for each damping.

    Attributes:
        A: State matrices, shape ``(i, n, n)``.
        B: Input column, shape ``(n,)``.
        C: Output row, shape ``(n,)``.
        modes: Frequency and half width of each mode [rad/s], shape ``(i, m, 2)``.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    modes: np.ndarray


class MapSettings(NamedTuple):
    """Settings of the loops of a map.

    Attributes:
        period: Sampling periods [s], shape ``(m,)``.
        virtual_damping: Virtual dampings, shape ``(j,)``.
        steps: Whole periods in the delay, for each delay and period, shape ``(k, m)``.
        rest: Delay in addition to the whole periods [s], shape ``(k, m)``.
        low: Lowest frequency [rad/s], for each damping, virtual damping, delay and period, ``(i, j, k, m)``.
    """

    period: np.ndarray
    virtual_damping: np.ndarray
    steps: np.ndarray
    rest: np.ndarray
    low: np.ndarray


@jit
def map_lowest_gain(devices, settings, stiffness, frequency):
    """Fill the maps of stiffness and frequency, ``(damping, virtual damping, delay, period)``, see `lowest_gain`."""
    A, B, C, modes = devices
    period, virtual_damping, steps, rest, low = settings
    for i in range(A.shape[0]):
        for k in range(steps.shape[0]):
            for m in range(len(period)):
                transition, newer, older = delayed_input(A[i], B, period[m], rest[k, m])
                polynomials = loop_polynomials(transition, newer, older, C)
                loop = (steps[k, m], 0.0, 0.0, polynomials[0], polynomials[1], polynomials[2])
                delay = steps[k, m] * period[m] + rest[k, m]
                for j in range(len(virtual_damping)):
                    stiffness[i, j, k, m], frequency[i, j, k, m] = lowest_gain(
                        low[i, j, k, m], modes[i], period[m], delay, loop, virtual_damping[j]
                    )
