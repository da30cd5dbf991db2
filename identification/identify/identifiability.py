"""States for each parameter whether a recording identifies it: alone, in combination with others, or not at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.data.log import Log
from identification.estimators.fit import Fit, unfiltered_log
from identification.identify.identification import BodyParameters, Parameter, Share, Unidentified
from identification.regression.base_parameters import BaseParameters, base_parameters
from identification.regression.regressor import EffectOnJoint, torque_regressor
from identification.words.numbers_and_names import number
from phantom_dyn.model.inertia import STANDARD_NAMES, body_name
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.random_streams import random_stream

SURE = 2.0
"""A value counts as identified if it is more than this many standard deviations from zero. Of parameters that are zero,
about 5 % are farther by chance."""

_SAMPLES = 200  # number of random samples, several times as many as any robot needs
_SHOWN = 4  # largest number of names that a sentence lists


def excited_base(robot: Robot, log: Log, effects: Sequence[EffectOnJoint]) -> BaseParameters:
    """Base parameters of the robot for a random motion, which excites all of them.

    The positions of a closed chain are those of the recording, because its loops cannot be closed at all positions.

    Args:
        robot: The robot, with its rigid bodies.
        log: A recording of the robot.
        effects: Effects on joints whose parameters are estimated as well.
    """
    rng = random_stream("excited base parameters")
    if robot.chain is None:
        q = np.where(robot.prismatic, 1.0, np.pi) * rng.uniform(-1, 1, (_SAMPLES, robot.nv))
    else:
        q = log.motion.q[np.linspace(0, len(log.motion.t) - 1, _SAMPLES).astype(int)]
    v, a = rng.standard_normal((2, _SAMPLES, robot.nv))
    random_log = unfiltered_log(robot, Motion(np.arange(float(_SAMPLES)), q, v, a))
    return base_parameters(torque_regressor(robot, random_log, effects))


def identified_shares(base: BaseParameters) -> tuple[Share, ...]:
    """For every parameter, whether it is identified alone, in a combination, or not at all.

    A parameter is identified alone if its column is independent, and no other parameter is regrouped into it.
    """
    out: list[Share] = ["combination"] * len(base.names)
    for row, k in enumerate(base.independent):
        if not base.regrouped[row].any():
            out[k] = "alone"
    for k in base.zero:
        out[k] = "none"
    return tuple(out)


def regrouped_into(base: BaseParameters) -> dict[int, tuple[str, ...]]:
    """For each dependent column, the base parameters that contain it."""
    names = base.base_names
    return {k: tuple(names[row] for row in np.flatnonzero(base.regrouped[:, d])) for d, k in enumerate(base.dependent)}


def body_table(robot: Robot, base: BaseParameters, excited: BaseParameters) -> tuple[BodyParameters, ...]:
    """For each body, which of its ten parameters can be identified.

    Args:
        robot: The robot; the parameters of its bodies are the first columns.
        base: Base parameters of the recording.
        excited: Base parameters of a motion that excites everything.
    """
    recorded, any_motion = identified_shares(base), identified_shares(excited)
    return tuple(
        BodyParameters(
            body_name(robot, j),
            dict(zip(STANDARD_NAMES, recorded[10 * (j - 1) : 10 * j], strict=True)),
            dict(zip(STANDARD_NAMES, any_motion[10 * (j - 1) : 10 * j], strict=True)),
        )
        for j in range(1, robot.model.njoints)
    )


def unidentified(base: BaseParameters, excited: BaseParameters) -> tuple[Unidentified, ...]:
    """Every parameter that cannot be identified alone, with the reason.

    Args:
        base: Base parameters of the recording.
        excited: Base parameters of a motion that excites everything, over the same columns.
    """
    containing = regrouped_into(base)
    never_torque, always_dependent = set(excited.zero), set(excited.dependent)
    out = []
    for k in base.dependent:
        sums = ", ".join(containing[k][:_SHOWN]) + (", ..." if len(containing[k]) > _SHOWN else "")
        if k in base.zero and k in never_torque:
            why = "no motion of this robot makes it produce torque"
        elif k in base.zero:
            why = "it produces no torque in this recording: move more joints, or in other postures"
        elif k in always_dependent:
            why = f"in every motion of this robot it shows only within {sums}"
        else:
            why = f"in this recording it shows only within {sums}; another motion can separate them"
        out.append(Unidentified(base.names[k], base.units[k], why))
    return tuple(out)


def not_excited(base: BaseParameters, excited: BaseParameters) -> tuple[str, ...]:
    """Parameters that are identified alone by a motion that excites everything, but not by this recording."""
    return tuple(base.names[k] for k in base.dependent if k in set(excited.independent))


def parameters(fit: Fit) -> tuple[tuple[Parameter, ...], tuple[Parameter, ...]]:
    """Result for each base parameter of the links, and for each parameter of friction and drives."""
    sums = fit.base.sums()
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
            regroups=sums.get(row, ""),
            identified=sure,
            why="" if sure else _why(value, std, unit),
            joint=joint,
            effect=effect,
        )
        (links if k < fit.first_effect else others).append(parameter)
    return tuple(links), tuple(others)


def _owners(fit: Fit) -> dict[str, tuple[str | None, str]]:
    """Joint and effect of each column of an effect, by the column's name."""
    out: dict[str, tuple[str | None, str]] = {}
    for name in fit.base.names[fit.first_effect :]:
        term = next(term for term in fit.effects if name.startswith(f"{term.label}."))
        out[name] = (term.joint, term.effect.name)
    return out


def _why(value: float, std: float, unit: str) -> str:
    """Why a base parameter does not count as identified."""
    if not np.isfinite(std):
        return "no more equations than unknowns, so its deviation is not known"
    return f"not distinguished from zero: its size is below {number(abs(value) + SURE * std)} {unit} (95 %)"
