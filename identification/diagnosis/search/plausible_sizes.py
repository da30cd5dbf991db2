"""Which sizes of an effect are plausible: ranges that depend on the recording, and the first size outside of any range.

Ranges that hold for every robot are written in each effect, with their reason. Those of this table are relative to the
recorded torque and speed of the joint. No sound robot has a size outside of its range: a rival of a plausible size
leads in its place, and where there is none, the finding does not count for the verdict "explained". A size whose
interval reaches into the range may be plausible: a slow motion hardly shows the mass of a load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.search.containment import joints_of
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Effect, Parameter

# Deviations by which a size has to be outside of its range.
_DEVIATIONS = 2.0


@dataclass(frozen=True)
class Range:
    """The upper end of a plausible range, relative to what was recorded of the joint.

    Attributes:
        units: Units of the parameters that it limits, on a hinge and on a linear joint.
        by_speed: True if it is relative to the largest torque over the largest speed, else to the largest torque.
        most: Upper end of the range in these units.
        because: The reason, from how a drive works.
    """

    units: tuple[str, str]
    by_speed: bool
    most: float
    because: str


# The range is twice as wide as its reason says, as a torque may be recorded too small by as much.
RANGES: tuple[Range, ...] = (
    Range(
        ("N m", "N"),
        False,
        2.0,
        "a drive that moves a joint gives its friction at least, and this is more than twice the largest torque that "
        "was recorded",
    ),
    Range(
        ("N m s/rad", "N s/m"),
        True,
        2.0,
        "a drive that moves a joint gives its friction at least, and at the largest speed this is more than twice the "
        "largest torque that was recorded",
    ),
)


def implausible_size(
    session: Session, term: Term, theta: Float[Array, " k"], cov: Float[Array, "k k"] | None = None
) -> tuple[Parameter, float] | None:
    """The first parameter of a fitted effect that no sound robot has, and its value; None if a robot may have all.

    Args:
        session: The given model, and what its drives did.
        term: An effect.
        theta: Coefficients of its columns.
        cov: Their covariance; None: they are exact.
    """
    if not isinstance(term.effect, Effect) or term.effect.inertial == "free":
        return None
    parameters = term.effect.parameters(session.robot, term.joint)
    values = _sizes(session, term, theta, len(parameters))
    reach = np.zeros_like(values) if cov is None else _DEVIATIONS * _deviations(session, term, theta, cov, values)
    for stated, own, may_err in zip(parameters, values, reach, strict=True):
        parameter = _limited(session, term, stated)
        if parameter.plausible is None:
            continue
        low, high = parameter.plausible
        outside = own[(own + may_err < low) | (own - may_err > high)]
        if len(outside):
            return parameter, float(outside[0])
    return None


def _sizes(session: Session, term: Term, theta: Float[Array, " k"], count: int) -> Float[Array, "p n"]:
    """Sizes of an effect, one row for each of its parameters."""
    assert isinstance(term.effect, Effect)
    return np.reshape(term.effect.from_coefficients(session.robot, term.joint, theta, term.shape), (count, -1))


def _deviations(
    session: Session, term: Term, theta: Float[Array, " k"], cov: Float[Array, "k k"], values: Float[Array, "p n"]
) -> Float[Array, "p n"]:
    """Standard deviation of each size, by the change of all sizes along each axis of the covariance."""
    squares, axes = np.linalg.eigh(cov)
    steps = (axes * np.sqrt(np.maximum(squares, 0.0))).T
    changed = [_sizes(session, term, theta + step, len(values)) - values for step in steps]
    return np.sqrt(np.sum(np.square(changed), axis=0))


def _limited(session: Session, term: Term, parameter: Parameter) -> Parameter:
    """The parameter with the range of this table, where it ends below the range of the effect."""
    if parameter.plausible is None:
        return parameter
    rows = [session.robot.joint_names.index(one) for one in joints_of(term) if one in session.robot.joint_names]
    for one in RANGES:
        if not rows or parameter.unit not in one.units or not (one.by_speed or term.effect.rubs):
            continue
        # A joint whose torque or speed was not recorded sets no limit.
        measure = session.largest_torque[rows] / (session.largest_speed[rows] if one.by_speed else 1.0)
        most = one.most * float(np.max(measure))
        low, high = parameter.plausible
        if 0.0 < most < high:
            return replace(parameter, plausible=(low, most), plausible_because=one.because)
    return parameter
