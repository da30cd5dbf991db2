r"""The fewest assumptions under which the published improvements of the PHANToM follow from its models.

Cavusoglu, Feygin and Tendick (2002, section 5) print three ratios and few values; the models of their paper alone give
none of them (`phantom_dyn.haptics.stability.phantom_improvements`). Here each ratio has the numbers that must be added
for it to follow, found by solving the exact sampled loop for them. **None is published, and none is measured here:**
they say what would have to be so.

- **Wall, 2.0 to 2.7 N/mm.** The linear condition :math:`K < b / (T/2 + t_d)` has the ratio :math:`1 + 2 t_d / T` for
  any damping: a stock amplifier that is late by some 0.175 ms gives +35 %. Both values need a damping of hand and arm,
  too, 1.34 N s/m, and then the mass (52.5 g along y) does not count.
- **Damping, 5.0 to 11 N s/m.** The strongest virtual damper "over the entire workspace" is that of the lightest
  direction, z with 32.2 g at the origin by the dynamic model. With the lags of both estimators, which are published,
  one number is left: a damping of the hand of 1.11 N s/m gives the ratio, and with it **both values** within 0.2 %,
  which it was not fitted to. A hand without damping gives 5.7 times. This is the linear loop; with the encoder's edges
  the period measurement bears some 7 N s/m: the "additional software logic" of the paper is not described.
- **Loop gain, +50 %.** Again the ratio of the linear condition: a stock amplifier that is late by 0.25 ms, at any
  damping of the two devices.

Wall and loop gain together need one more: with one amplifier late by 0.25 ms the wall has its +35 % only if it is 0.21
ms later than the teleoperation in both set-ups, 0.25 / 0.35 ms less half a period.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from phantom_dyn.errors import EstimationError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_estimators import IMPROVED, STOCK
from phantom_dyn.haptics.stability.critical_stiffness import critical_stiffness
from phantom_dyn.haptics.stability.phantom_improvements import (
    PUBLISHED_DAMPING,
    PUBLISHED_LOOP_GAIN_RATIO,
    PUBLISHED_WALL,
    operational_masses,
)
from phantom_dyn.haptics.stability.virtual_wall import critical_damping_gain

_PERIOD = LoopSettings().period
_MOST_DAMPING = 20.0
"""Damping of a hand that is looked for [N s/m]; beyond it a tip of 32 g comes to rest within two samples."""


@dataclass(frozen=True)
class Assumption:
    """A number that is not published and that a published ratio needs.

    Attributes:
        says: What is assumed.
        value: The number that the ratio needs.
        unit: Its unit.
    """

    says: str
    value: float
    unit: str


@dataclass(frozen=True)
class Explained:
    """A published improvement, and a model that gives it under stated assumptions.

    Attributes:
        quantity: What was improved.
        unit: Of both figures.
        published: Figures before and after, None where none are published.
        published_ratio: After over before.
        assumptions: All that is added to the published models.
        before: What the model then gives for the stock set-up.
        after: The same for the improved one.
    """

    quantity: str
    unit: str
    published: tuple[float, float] | None
    published_ratio: float
    assumptions: tuple[Assumption, ...]
    before: float
    after: float

    @property
    def ratio(self) -> float:
        """After over before."""
        return self.after / self.before


def explained_wall() -> Explained:
    """Stiffest wall along y of a device that is held with some damping, the stock amplifier late by some lag.

    Two numbers for two published figures; the lag alone sets the ratio.
    """
    mass, (before, after) = operational_masses()[1], PUBLISHED_WALL

    def stiffest(damping: float, lag: float) -> float:
        return critical_stiffness(RigidAxis(mass, damping), period=_PERIOD, delay=lag).stiffness

    damping = _solved(lambda b: stiffest(b, 0.0) - after, 0.01, _MOST_DAMPING)
    lag = _solved(lambda late: before - stiffest(damping, late), 0.0, _PERIOD)
    return Explained(
        "virtual wall stiffness",
        "N/m",
        PUBLISHED_WALL,
        after / before,
        (
            Assumption("a stock amplifier that is late", 1e3 * lag, "ms"),
            Assumption("hand and arm with a damping along y", damping, "N s/m"),
        ),
        stiffest(damping, lag),
        stiffest(damping, 0.0),
    )


def explained_damping() -> Explained:
    """Strongest virtual damper along z, the lightest direction, in a hand with some damping: one number for a ratio."""
    mass, ratio = min(operational_masses()), PUBLISHED_DAMPING[1] / PUBLISHED_DAMPING[0]

    def strongest(damping: float) -> tuple[float, float]:
        axis = RigidAxis(mass, damping)
        stock, improved = (critical_damping_gain(axis, LoopSettings(estimator=one)).gain for one in (STOCK, IMPROVED))
        return stock, improved

    def beyond(damping: float) -> float:
        stock, improved = strongest(damping)
        return ratio - improved / stock

    damping = _solved(beyond, 0.0, _MOST_DAMPING)
    return Explained(
        "virtual damping",
        "N s/m",
        PUBLISHED_DAMPING,
        ratio,
        (Assumption(f"hand and arm with a damping along z, {1e3 * mass:.1f} g", damping, "N s/m"),),
        *strongest(damping),
    )


def explained_loop_gain() -> Explained:
    """Largest gain between two equal devices with the damping of the wall, the stock amplifiers late by some lag.

    One number for a ratio; the damping sets both values, which are not published, and not their ratio.
    """
    damping = explained_wall().assumptions[1].value
    axis = RigidAxis(operational_masses()[1], damping)

    def largest(lag: float) -> float:
        # Only the difference is fed back, and it answers a force as both devices together do: half a wall's gain.
        return 0.5 * critical_stiffness(axis, period=_PERIOD, delay=lag).stiffness

    after = largest(0.0)
    lag = _solved(lambda late: after / largest(late) - PUBLISHED_LOOP_GAIN_RATIO, 0.0, _PERIOD)
    return Explained(
        "teleoperation loop gain",
        "N/m",
        None,
        PUBLISHED_LOOP_GAIN_RATIO,
        (Assumption("stock amplifiers that are late", 1e3 * lag, "ms"),),
        largest(lag),
        after,
    )


def explained_improvements() -> tuple[Explained, Explained, Explained]:
    """Wall, damping and loop gain, in the order of `phantom_improvements`."""
    return explained_wall(), explained_damping(), explained_loop_gain()


def _solved(beyond: Callable[[float], float], low: float, high: float) -> float:
    """Where a rising function of one number passes zero, to 1e-10 of the width."""
    # Imported here: scipy.optimize takes longer to import than the rest of haptics.
    from scipy.optimize import brentq

    if not beyond(low) < 0 < beyond(high):
        raise EstimationError(
            f"No number from {low:g} to {high:g} gives the published figure: the assumption does not explain it."
        )
    return cast(float, brentq(beyond, low, high, xtol=1e-10 * (high - low)))
