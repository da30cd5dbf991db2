"""A fit as rows of a table: value, deviation, what it is the sum of, and whether it differs from zero."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.diagnosis.numbers import number
from identification.estimators.fit import Fit
from identification.identify.result import JointError, Parameter
from phantom_dyn.robot import Robot

Array = np.ndarray

SURE = 2.0
"""So many standard deviations from zero a value is called identified: about 95 % of values that are zero are not."""


def parameters(fit: Fit) -> tuple[tuple[Parameter, ...], tuple[Parameter, ...]]:
    """Base parameters of the links, and those of friction and drives.

    Args:
        fit: The fit.
    """
    sums = dict(equation.split(" = ", 1) for equation in fit.base.regroupings())
    owners = _owners(fit)
    links: list[Parameter] = []
    others: list[Parameter] = []
    for row, k in enumerate(fit.base.independent):
        value, std, unit = float(fit.theta[row]), float(fit.std()[row]), fit.units[row]
        sure = bool(abs(value) > SURE * std)
        joint, effect = owners.get(fit.base.names[k], (None, None))
        parameter = Parameter(
            name=fit.names[row],
            value=value,
            std=std,
            unit=unit,
            regroups=sums.get(fit.names[row], ""),
            identified=sure,
            why="" if sure else _why(value, std, unit),
            joint=joint,
            effect=effect,
        )
        (links if k < fit.first_effect else others).append(parameter)
    return tuple(links), tuple(others)


def joint_errors(
    robot: Robot,
    measured: Float[Array, "N nv"],
    predicted: Float[Array, "N nv"],
    given: Float[Array, "N nv"],
    fitted: Float[Array, " nv"],
) -> tuple[JointError, ...]:
    """Errors of every joint on held-out samples.

    Args:
        robot: Gives names and units.
        measured: Torque in the band.
        predicted: By the fit.
        given: By the given model.
        fitted: Relative error [%] on the samples of the fit.
    """
    size = np.sqrt(np.mean(measured**2, axis=0))
    rms, before = (np.sqrt(np.mean((measured - model) ** 2, axis=0)) for model in (predicted, given))
    relative, relative_given = (_over(values, size) for values in (rms, before))
    return tuple(
        JointError(
            joint,
            unit,
            float(rms[j]),
            float(relative[j]),
            float(relative_given[j]),
            float(fitted[j]) / 100,
            len(measured),
        )
        for j, (joint, unit) in enumerate(zip(robot.joint_names, robot.torque_units, strict=True))
    )


def _over(values: Array, size: Array) -> Array:
    out = np.full(len(values), np.nan)
    return np.divide(values, size, out=out, where=size > 0)


def _owners(fit: Fit) -> dict[str, tuple[str | None, str]]:
    """Joint and effect of each effect's column."""
    out: dict[str, tuple[str | None, str]] = {}
    for name in fit.base.names[fit.first_effect :]:
        term = next(term for term in fit.effects if name.startswith(f"{term.label}."))
        out[name] = (term.joint, term.effect.name)
    return out


def _why(value: float, std: float, unit: str) -> str:
    if not np.isfinite(std):
        return "no more equations than unknowns, so its deviation is not known"
    return f"not told from zero: its size is below {number(abs(value) + SURE * std)} {unit} (95 %)"
