r"""Compares three published improvements of the PHANToM with models, and computes which numbers would explain them.

Cavusoglu, Feygin and Tendick (2002, section 5) improved the stiffness of a virtual wall from 2.0 to 2.7 N/mm (+35 %),
virtual damping from 0.0050 to 0.011 N/(mm/s) (+120 %), and the loop gain of teleoperation by 50 % (no values). They
changed the amplifiers, and for the damping the velocity estimator.

**Published models** (`phantom_improvements`). In x and y the published transfer functions are unstable with a virtual
wall of any stiffness, because their phase lead is too small for the hold and they have no damper to ground. In z they
are stable for every stiffness, because the position responds to force without delay. So they explain neither the walls
nor the loop gain. The dynamic model, whose axes have no damping, does not explain them either. Nothing is fitted here:
a model without an answer has the value 0 or infinite, and `says` gives the reason. `needs` states the damper or delay
that the published values would require.

**Models with added numbers** (`explained_improvements`). The exact sampled loop is solved for the smallest set of
numbers from which each ratio follows. **None of these numbers is published, and none is measured here.**

- **Wall, 2.0 to 2.7 N/mm.** By the linear condition :math:`K < b / (T/2 + t_d)` the ratio is :math:`1 + 2 t_d / T` for
  any damping: a stock amplifier with a delay of some 0.175 ms gives +35 %. Both values also need a damping of hand and
  arm of 1.34 N s/m, with which the mass (52.5 g along y) does not matter.
- **Damping, 5.0 to 11 N s/m.** The strongest virtual damper "over the entire workspace" is limited by the lightest
  direction, z with 32.2 g at the origin in the dynamic model. The lags of both estimators are published, so that one
  number is unknown. A damping of the hand of 1.11 N s/m gives the ratio; it also gives **both values** within 0.2 %,
  although it was not fitted to them. A hand without damping gives a ratio of 5.7. These are results of the linear loop;
  with the steps of the encoder, velocities from the time between steps allow some 7 N s/m. The paper does not describe
  its "additional software logic".
- **Loop gain, +50 %.** By the linear condition, a stock amplifier with a delay of 0.25 ms gives the ratio for any
  damping of the two devices.

Wall and loop gain together need one more number. Suppose that the amplifier of the wall has this delay of 0.25 ms, too.
Then +35 % needs 0.25 ms = 0.35 (T/2 + d): in both set-ups the loop of the wall has a further delay d = 0.21 ms, which
the loop of teleoperation does not have.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np

from phantom_dyn.devices.phantom import PHANTOM_1_5, mass_matrix
from phantom_dyn.errors import EstimationError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.device.published import PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z
from phantom_dyn.haptics.device.transfer_function import Axis
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_estimators import IMPROVED, STOCK
from phantom_dyn.haptics.stability.critical_stiffness import critical_stiffness
from phantom_dyn.haptics.stability.virtual_wall import (
    critical_damping_gain,
    critical_loop_gain,
    critical_wall,
    simulated_damping_gain,
)

PUBLISHED_WALL = (2.0e3, 2.7e3)
"""Largest stiffness before and after the improvement [N/m], along y and without virtual damping."""
PUBLISHED_DAMPING = (5.0, 11.0)
"""Largest virtual damping before and after the improvement [N s/m]."""
PUBLISHED_LOOP_GAIN_RATIO = 1.5
"""Loop gain after the improvement over that before; the values are not published."""

_FITS = (("x", PHANTOM_1_5_X), ("y", PHANTOM_1_5_Y), ("z", PHANTOM_1_5_Z))


@dataclass(frozen=True)
class ModelFigure:
    """Value of one model before and after the improvement.

    Attributes:
        model: Name of the model.
        unit: Unit of both values; that of a published fit is not stated.
        before: Value with the stock set-up: 0 if every gain is unstable, infinite if every gain is stable.
        after: Value with the improved set-up.
        says: A sentence that compares the value with the published one.
    """

    model: str
    unit: str
    before: float
    after: float
    says: str

    @property
    def ratio(self) -> float:
        """After over before; NaN if the model has no answer."""
        return self.after / self.before if 0 < self.before < math.inf else math.nan


@dataclass(frozen=True)
class Improvement:
    """A published improvement, and the values of models.

    Attributes:
        quantity: Name of the improved quantity.
        published: Values before and after; None if they are not published.
        unit: Unit of the values.
        published_ratio: After over before.
        models: Values of the models.
        needs: A sentence with the assumption from which the published values would follow.
    """

    quantity: str
    published: tuple[float, float] | None
    unit: str
    published_ratio: float
    models: tuple[ModelFigure, ...]
    needs: str


def operational_masses() -> tuple[float, float, float]:
    """Masses of the tip along x, y and z at the origin of the PHANToM 1.5 [kg], from its dynamic model."""
    diagonal = np.diag(mass_matrix(np.zeros((1, 3)))[0])
    levers = np.array([PHANTOM_1_5.l1, PHANTOM_1_5.l1, PHANTOM_1_5.l2])
    x, y, z = diagonal / levers**2
    return float(x), float(y), float(z)


def wall_improvement() -> Improvement:
    """Stiffness of a virtual wall, +35 % by other amplifiers; no published model contains an amplifier."""
    settings = LoopSettings()
    before, after = PUBLISHED_WALL
    half = settings.period / 2
    return Improvement(
        "virtual wall stiffness",
        PUBLISHED_WALL,
        "N/m",
        after / before,
        tuple(_same(name, critical_wall(axis, settings).gain) for name, axis in _models()),
        f"By the linear condition K < b / (T/2 + t_d) the walls need a damping of {before * half:g} and "
        f"{after * half:g} N s/m, or, with the same damping for both, a delay of the stock amplifier of "
        f"{half * (after / before - 1) * 1e3:g} ms and none of the improved one; neither is published.",
    )


def loop_gain_improvement() -> Improvement:
    """Loop gain of teleoperation, +50 %, by other amplifiers."""
    settings = LoopSettings()
    return Improvement(
        "teleoperation loop gain",
        None,
        "N/m",
        PUBLISHED_LOOP_GAIN_RATIO,
        tuple(_same(name, critical_loop_gain(axis, axis, settings).gain) for name, axis in _models()),
        "By the linear condition a later amplifier costs wall and loop gain the same share, whatever the damping: "
        f"{_percent(PUBLISHED_WALL[1] / PUBLISHED_WALL[0])} of the one and {_percent(PUBLISHED_LOOP_GAIN_RATIO)} "
        "of the other cannot both come from a delay.",
    )


def damping_improvement() -> Improvement:
    """Virtual damping, +120 %, by another velocity estimator, whose lag the models contain."""
    stock, improved = LoopSettings(estimator=STOCK), LoopSettings(estimator=IMPROVED)
    mass = operational_masses()[1]
    rigid = RigidAxis(mass, 0.0)
    linear = _linear_damping(rigid)
    before, after = (simulated_damping_gain(rigid, s, low=0.1, high=100.0) for s in (stock, improved))
    name = f"rigid, {mass * 1e3:.1f} g"
    figures = [
        ModelFigure(f"{name}, linear", "N s/m", *linear, "The two lags alone, without hand or resonance."),
        ModelFigure(
            f"{name}, simulated",
            "N s/m",
            before,
            after,
            "At low speed the estimator waits for edges of the encoder, so that an oscillation of a few steps already "
            "persists below the linear limit.",
        ),
    ]
    for fit, axis in _FITS:
        says = "The fit's units are not stated: only its ratio can be compared."
        figures.append(
            ModelFigure(f"published fit of {fit}, linear", "in the fit's units", *_linear_damping(axis), says)
        )
    needed = [published / gain * mass * 1e3 for published, gain in zip(PUBLISHED_DAMPING, linear, strict=True)]
    return Improvement(
        "virtual damping",
        PUBLISHED_DAMPING,
        "N s/m",
        PUBLISHED_DAMPING[1] / PUBLISHED_DAMPING[0],
        tuple(figures),
        f"The limit of a rigid device is proportional to its mass: the published figures need {needed[0]:.0f} g before "
        f"and {needed[1]:.0f} g after, so no one mass of device and hand gives both.",
    )


def phantom_improvements() -> tuple[Improvement, Improvement, Improvement]:
    """Wall, damping and loop gain, in the order of the paper's abstract."""
    return wall_improvement(), damping_improvement(), loop_gain_improvement()


def _linear_damping(axis: Axis) -> tuple[float, float]:
    """Largest virtual damping with the stock estimator and with the improved one."""
    stock, improved = LoopSettings(estimator=STOCK), LoopSettings(estimator=IMPROVED)
    return critical_damping_gain(axis, stock).gain, critical_damping_gain(axis, improved).gain


def _models() -> list[tuple[str, Axis]]:
    """Names and models of the axes without an amplifier: the rigid mass along y, and the three published fits."""
    mass = operational_masses()[1]
    rigid = (f"rigid, {mass * 1e3:.1f} g, no damper", RigidAxis(mass, 0.0))
    return [rigid, *((f"published fit of {name}", axis) for name, axis in _FITS)]


def _same(name: str, gain: float) -> ModelFigure:
    """Value of a model that contains no amplifier, so that before and after are equal."""
    if gain == 0.0:
        says = "Unstable for every gain, so that it cannot give the published figure."
    elif gain == math.inf:
        says = "Stable for every gain, so that it cannot give the published figure."
    else:
        says = "It contains no amplifier, so that before and after are the same."
    return ModelFigure(name, "N/m", gain, gain, says)


def _percent(ratio: float) -> str:
    """Improvement by a ratio in per cent, such as ``+50 %``."""
    return f"{100 * (ratio - 1):+.0f} %"


_PERIOD = LoopSettings().period
# Largest damping of a hand in the search [N s/m]; with it, a tip of 32 g comes to rest within two samples.
_MOST_DAMPING = 20.0


@dataclass(frozen=True)
class Assumption:
    """An unpublished number from which a published ratio follows.

    Attributes:
        says: Meaning of the number.
        value: The number.
        unit: Unit of the number.
    """

    says: str
    value: float
    unit: str


@dataclass(frozen=True)
class Explained:
    """A published improvement, and the values of a model under stated assumptions.

    Attributes:
        quantity: Name of the improved quantity.
        unit: Unit of the values.
        published: Values before and after; None if they are not published.
        published_ratio: After over before.
        assumptions: Numbers that are added to the published models.
        before: Value of the model for the stock set-up.
        after: Value of the model for the improved set-up.
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
    """Stiffest wall along y for a device in a hand with some damping, and a stock amplifier with some delay.

    Two numbers explain two published values; the delay alone determines the ratio.
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
    """Strongest virtual damper along z, the lightest direction, in a hand with some damping.

    One number explains a ratio.
    """
    mass, ratio = min(operational_masses()), PUBLISHED_DAMPING[1] / PUBLISHED_DAMPING[0]

    def beyond(damping: float) -> float:
        stock, improved = _linear_damping(RigidAxis(mass, damping))
        return ratio - improved / stock

    damping = _solved(beyond, 0.0, _MOST_DAMPING)
    return Explained(
        "virtual damping",
        "N s/m",
        PUBLISHED_DAMPING,
        ratio,
        (Assumption(f"hand and arm with a damping along z, {1e3 * mass:.1f} g", damping, "N s/m"),),
        *_linear_damping(RigidAxis(mass, damping)),
    )


def explained_loop_gain() -> Explained:
    """Largest gain between two equal devices with the damping of `explained_wall` and delayed stock amplifiers.

    One number explains a ratio. The damping determines both values, which are not published, but not their ratio.
    """
    _, hand = explained_wall().assumptions
    axis = RigidAxis(operational_masses()[1], hand.value)

    def largest(lag: float) -> float:
        # Only the difference is fed back. It responds to a force with twice the motion of one device, which halves the
        # gain.
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
    """Zero of an increasing function between ``low`` and ``high``, exact to 1e-10 of the interval."""
    # Imported here: scipy.optimize takes longer to import than the rest of haptics.
    from scipy.optimize import brentq

    if not beyond(low) < 0 < beyond(high):
        raise EstimationError(
            f"No number from {low:g} to {high:g} gives the published figure: the assumption does not explain it."
        )
    return cast(float, brentq(beyond, low, high, xtol=1e-10 * (high - low)))
