"""Minima within bounds of problems that differ from a solved one by some unknowns: what changes is solved for alone.

The solved problem is kept as its principal pivot transform: what every unknown answers to a force on one that is free,
or to a shift of one that is held. Unknowns that enter, leave, meet a bound or come off one are then a small system of
their own (the Schur complement method for quadratic programs, Gill, Murray, Saunders and Wright, 1990), whose size is
the number of changes and not that of the problem.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.numerics.bounded import bounded_solve
from phantom_dyn.array_types import Bool, Float, Int

Array = np.ndarray

# What keeps exact twins solvable; more than in `bounded`, as an inverse loses twice the digits that a solution does.
_TWINS = 1e-11
# Steps at most where one bound at a time is met or left, and exchanges of all that is amiss at once in a row that may
# leave no less amiss than there ever was.
_STEPS, _TRIES = 500, 3
# Steps that take the rounding of an inverse out of what is solved with it.
_REFINED = 3
# A multiplier is of the wrong sign from this size on, or from this share of the largest product with the residual.
_WRONG, _ROUNDING = 1e-9, 1e-12


@dataclass(frozen=True)
class Entering:
    """Unknowns that a solved problem does not contain, in its scale.

    Attributes:
        cross: Products of these with the solved problem's unknowns, ``(m, n)``.
        answer: What the solved problem's unknowns answer to a shift of each, ``(m, n)``.
        square: Products among these, ``(m, m)``.
        among: What the slopes of these answer to a shift of each, ``(m, m)``.
        slope: Of the loss by each, at zero, ``(m,)``.
        scale: Unit of each, ``(m,)``.
    """

    cross: Float[Array, "m n"]
    answer: Float[Array, "m n"]
    square: Float[Array, "m m"]
    among: Float[Array, "m m"]
    slope: Float[Array, " m"]
    scale: Float[Array, " m"]


@dataclass(frozen=True)
class Settled:
    """The minimum of a changed problem.

    Attributes:
        x: All unknowns, those of the solved problem first, ``(n + m,)``.
        slope: Of the loss by each, zero where it is free, ``(n + m,)``.
        less: What ``x a x - 2 b x`` is less than at the minimum of the solved problem.
        flipped: Unknowns that are free here and held in the solved problem, or the other way round, ``(k,)``.
        action: What makes the change: see `Tableau.answers`; beside those that are flipped those that are held
            elsewhere.
    """

    x: Float[Array, " v"]
    slope: Float[Array, " v"]
    less: float
    flipped: Int[Array, " k"]
    action: tuple[Int[Array, " d"], Float[Array, " d"]]


@dataclass(frozen=True)
class Tableau:
    """A solved problem ``x a x / 2 - b x`` within bounds, in units in which ``a`` has a diagonal of ones.

    Attributes:
        a: Quadratic part, ``(n, n)``.
        b: Linear part, ``(n,)``.
        scale: Unit of each unknown, ``(n,)``.
        held: Unknowns at a bound, ``(n,)``.
        x: Minimum, ``(n,)``.
        state: Unknowns that are free, slopes of those that are held, ``(n,)``.
        answer: What the state answers to a force on an unknown that is free or a shift of one that is held, one line
            an action, ``(n, n)``.
        rounding: Size below which a slope is nothing.
    """

    a: Float[Array, "n n"]
    b: Float[Array, " n"]
    scale: Float[Array, " n"]
    held: Bool[Array, " n"]
    x: Float[Array, " n"]
    state: Float[Array, " n"]
    answer: Float[Array, "n n"]
    rounding: float

    def pieces(
        self, cross: Float[Array, "m n"], diagonal: Float[Array, " m"], b: Float[Array, " m"]
    ) -> tuple[Float[Array, "m n"], Float[Array, "m n"], Float[Array, " m"], Float[Array, " m"]]:
        """What further unknowns enter with: cross products, answer, slope and scale of `Entering`.

        Args:
            cross: Products of these with the solved problem's unknowns.
            diagonal: Products of each with itself, prior included.
            b: Their linear part.
        """
        unit = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
        cross = cross * self.scale * unit[:, None]
        free = ~self.held
        answer = -cross[:, free] @ self.answer[free]
        answer[:, self.held] += cross[:, self.held]
        return cross, answer, cross @ self.x - b * unit, unit

    def joined(
        self,
        cross: Float[Array, "m n"],
        answer: Float[Array, "m n"],
        slope: Float[Array, " m"],
        scale: Float[Array, " m"],
        square: Float[Array, "m m"],
    ) -> Entering:
        """Further unknowns together, from their pieces and the products among them, priors included."""
        square = square * scale[:, None] * scale
        square.flat[:: len(square) + 1] += _TWINS
        free = ~self.held
        return Entering(cross, answer, square, square + cross[:, free] @ answer[:, free].T, slope, scale)

    def changed(
        self,
        entering: Entering,
        leaving: Int[Array, " l"],
        bounds: tuple[Float[Array, " v"], Float[Array, " v"]],
        near: Float[Array, " v"],
    ) -> Settled:
        """Minimum with unknowns that enter and without some that are there.

        Args:
            entering: The former, which come last.
            leaving: Places of the latter, which are zero.
            bounds: Lower and upper ones of all.
            near: Minimum of a similar problem; the bounds that bind there are tried first. Where it is NaN, those that
                bind in the solved problem.
        """
        n, m = len(self.x), len(entering.scale)
        lower, upper = bounds
        unit = np.concatenate([self.scale, entering.scale])
        low, high = lower / unit, upper / unit
        wrong = np.maximum(_WRONG * unit, self.rounding)
        started = np.concatenate([self.held, np.ones(m, dtype=bool)])
        held, gone = started.copy(), np.zeros(n + m, dtype=bool)
        held[n:], gone[leaving] = False, True
        known = ~np.isnan(near)
        binds = known & ((near <= lower) | (near >= upper))
        held[known] = binds[known]
        value = np.concatenate([np.where(self.held, self.x, 0.0), np.zeros(m)])
        value = np.where(binds, np.where(near <= lower, low, high), value)
        held[leaving], value[leaving] = True, 0.0
        found = self._at_once(entering, held, value, (low, high), gone, wrong)
        if found is None:
            inside = np.where(known & ~gone, np.clip(near / unit, low, high), value)
            found = self._step_by_step(entering, held, np.where(held, value, inside), (low, high), gone, wrong)
        x = np.where(gone, 0.0, np.clip(found.x, low, high))
        # The slope changes in proportion from one minimum to the other.
        before = np.concatenate([np.where(self.held, self.state, 0.0), entering.slope])
        less = -float((before + found.slope) @ (x - np.concatenate([self.x, np.zeros(m)])))
        end = np.where(x <= low, lower, np.where(x >= high, upper, x * unit))
        return replace(found, x=np.where(gone, 0.0, end), slope=found.slope / unit, less=less)

    def _at_once(
        self,
        entering: Entering,
        held: Bool[Array, " v"],
        value: Float[Array, " v"],
        ends: tuple[Float[Array, " v"], Float[Array, " v"]],
        gone: Bool[Array, " v"],
        wrong: Float[Array, " v"],
    ) -> Settled | None:
        """Minimum by exchanging all that is amiss at once, in the tableau's units; None where that goes astray."""
        fewest, tries = len(held) + 1, _TRIES
        while tries >= 0:
            found = self._minimum(entering, held, value)
            amiss, outside = _amiss(found, held & ~gone, held, ends, wrong)
            if not amiss.any():
                # What is settled has to be so beyond rounding.
                found = self._refined(entering, held, found)
                amiss, outside = _amiss(found, held & ~gone, held, ends, wrong)
            count = int(np.count_nonzero(amiss))
            if count == 0:
                return found
            fewest, tries = (count, _TRIES) if count < fewest else (fewest, tries - 1)
            value = np.where(amiss & outside, np.where(found.x < ends[0], *ends), value)
            held = np.where(amiss, outside, held)
        return None

    def _step_by_step(
        self,
        entering: Entering,
        held: Bool[Array, " v"],
        x: Float[Array, " v"],
        ends: tuple[Float[Array, " v"], Float[Array, " v"]],
        gone: Bool[Array, " v"],
        wrong: Float[Array, " v"],
    ) -> Settled:
        """The same by steps within the bounds, each of which lowers the loss, so that no set of bounds comes twice."""
        held, x = held.copy(), x.copy()
        found = self._minimum(entering, held, x)
        for _ in range(_STEPS):
            _, outside = _amiss(found, held & ~gone, held, ends, wrong)
            if outside.any():
                places = np.flatnonzero(outside)
                end = np.where(found.x < ends[0], *ends)[places]
                share = np.clip((end - x[places]) / (found.x - x)[places], 0.0, 1.0)
                first = int(np.argmin(share))
                x = np.clip(x + share[first] * (found.x - x), *ends)
                x[places[first]] = end[first]
                held[places[first]] = True
            else:
                found = self._refined(entering, held, found)
                x = np.where(gone, 0.0, np.clip(found.x, *ends))
                pulls, _ = _amiss(replace(found, x=x), held & ~gone, held, ends, wrong)
                if not pulls.any():
                    break
                held[np.argmax(np.where(pulls, np.abs(found.slope), -1.0))] = False
            found = self._minimum(entering, held, x)
        return found

    def _minimum(self, entering: Entering, held: Bool[Array, " v"], value: Float[Array, " v"]) -> Settled:
        """Minimum with some unknowns held at values, in the tableau's units, without what it gains."""
        m = len(entering.scale)
        started = np.concatenate([self.held, np.ones(m, dtype=bool)])
        at = np.concatenate([np.where(self.held, self.x, 0.0), np.zeros(m)])
        state = np.concatenate([self.state, entering.slope])
        flipped = np.flatnonzero(held != started)
        elsewhere = np.flatnonzero(held & started & (value != at))
        places, k = np.concatenate([flipped, elsewhere]), len(flipped)
        answers, shift = self.answers(entering, places), value[elsewhere] - at[elsewhere]
        wanted = np.where(held[flipped], value[flipped], 0.0) - state[flipped] - shift @ answers[k:, flipped]
        action = np.concatenate([np.linalg.solve(answers[:k, flipped].T, wanted), shift])
        now = state + action @ answers
        x = np.where(started, at, now)
        # A shift moves what was held; a force on what was free is its slope.
        x[places] += np.where(started[places], action, 0.0)
        x[held] = value[held]
        slope = np.where(started & held, now, 0.0)
        forced = ~started[flipped]
        slope[flipped[forced]] = action[:k][forced]
        return Settled(x, slope, 0.0, flipped, (places, action))

    def _refined(self, entering: Entering, held: Bool[Array, " v"], found: Settled) -> Settled:
        """A minimum with the rounding of the tableau taken out, to first order."""
        slope = self._slope(entering, found.x)
        x = found.x + self._correction(entering, np.where(held, 0.0, -slope), held, found.flipped)
        return replace(found, x=x, slope=np.where(held, slope, 0.0))

    def _slope(self, entering: Entering, x: Float[Array, " v"]) -> Float[Array, " v"]:
        """Slope of the loss by all unknowns."""
        n = len(self.x)
        own, more = x[:n], x[n:]
        b = entering.cross @ self.x - entering.slope
        return np.concatenate(
            [self.a @ own + more @ entering.cross - self.b, entering.cross @ own + entering.square @ more - b]
        )

    def _correction(
        self, entering: Entering, force: Float[Array, " v"], held: Bool[Array, " v"], flipped: Int[Array, " k"]
    ) -> Float[Array, " v"]:
        """What unknowns that are free answer to a force on each of them.

        Args:
            entering: Unknowns that have entered.
            force: On all unknowns, zero where one is held.
            held: Those that are.
            flipped: Those that are held and were free, or the other way round.
        """
        n = len(self.x)
        answers = self.answers(entering, flipped)
        pushed = np.where(self.held, 0.0, force[:n])
        state = np.concatenate([pushed @ self.answer, -entering.answer @ pushed])
        action = np.linalg.solve(answers[:, flipped].T, force[flipped] - state[flipped])
        out = state + action @ answers
        started = np.concatenate([self.held, np.ones(len(held) - n, dtype=bool)])
        freed = started[flipped]
        out[started] = 0.0
        out[flipped[freed]] = action[freed]
        out[held] = 0.0
        return out

    def answers(self, entering: Entering, places: Int[Array, " d"]) -> Float[Array, "d v"]:
        """What the states of all unknowns answer to an action on each of some: see `answer`."""
        n = len(self.x)
        out = np.empty((len(places), n + len(entering.scale)))
        own, other = places < n, places[places >= n] - n
        here = places[own]
        out[own, :n] = self.answer[here]
        # A slope answers to a force as what is free answers to a shift, with the other sign.
        out[own, n:] = np.where(self.held[here], 1.0, -1.0)[:, None] * entering.answer[:, here].T
        out[~own, :n] = entering.answer[other]
        out[~own, n:] = entering.among[other]
        return out


def _amiss(
    found: Settled,
    bound: Bool[Array, " v"],
    held: Bool[Array, " v"],
    ends: tuple[Float[Array, " v"], Float[Array, " v"]],
    wrong: Float[Array, " v"],
) -> tuple[Bool[Array, " v"], Bool[Array, " v"]]:
    """Unknowns that are outside their bounds or pull off the bound that holds them, and the former alone."""
    x, slope, (low, high) = found.x, found.slope, ends
    outside = ~held & ((x < low) | (x > high))
    pulls = bound & (((x <= low) & (slope < -wrong)) | ((x >= high) & (slope > wrong)))
    return outside | pulls, outside


def tableau(
    a: Float[Array, "n n"],
    b: Float[Array, " n"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    near: Float[Array, " n"],
) -> Tableau:
    """Solve a problem and keep what changes of it are solved with.

    Args:
        a: Quadratic part, positive definite.
        b: Linear part.
        lower: Lower bounds.
        upper: Upper bounds.
        near: Minimum of a similar problem; NaN where there is none.
    """
    unit = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    x = bounded_solve(a, b, lower, upper, near) / unit
    held = (x <= lower / unit) | (x >= upper / unit)
    scaled, right = a * unit[:, None] * unit, b * unit
    scaled.flat[:: len(scaled) + 1] += _TWINS
    free, fixed = np.flatnonzero(~held), np.flatnonzero(held)
    inverse = np.linalg.inv(scaled[np.ix_(free, free)])
    inverse = 0.5 * (inverse + inverse.T)
    across = scaled[np.ix_(free, fixed)]
    answer = np.empty_like(scaled)
    made = inverse @ across
    answer[np.ix_(free, free)] = inverse
    answer[np.ix_(fixed, free)] = -made.T
    answer[np.ix_(free, fixed)] = made
    answer[np.ix_(fixed, fixed)] = scaled[np.ix_(fixed, fixed)] - across.T @ made
    # An inverse alone is not accurate where much cancels.
    for _ in range(_REFINED):
        x[free] += inverse @ (right[free] - scaled[free] @ x)
    state = np.where(held, scaled @ x - right, x)
    return Tableau(scaled, right, unit, held, x, state, answer, _ROUNDING * float(np.abs(right).max(initial=0.0)))
