"""Transmission stiffness read off resonances, as further shapes for the search.

The grid of transmission compliance is coarse. A torque rich enough to show a resonance determines the stiffness to a
few per cent, whatever the model of the links is; the search includes that compliance and scores it like all others.
"""

from __future__ import annotations

import numpy as np

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import FoundEffect
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.displaced import behind_encoder
from phantom_dyn.errors import EstimationError, LogError, ParameterError
from phantom_dyn.model.robot import Robot


def resonances(robot: Robot, logs: tuple[Log, ...]) -> tuple[FoundEffect, ...]:
    """Compliance of every joint whose vibration some recording shows, with an encoder on its motor's side.

    Args:
        robot: Says where the encoders sit.
        logs: Ready for fitting.
    """
    effect = effect_named("transmission_compliance")
    out = []
    for log in logs:
        for row, joint in enumerate(robot.joint_names):
            stiffness = None if behind_encoder(robot, row) else _stiffness(log, joint)
            if stiffness is not None:
                compliance = 1.0 / stiffness
                out.append(FoundEffect(effect, joint, (compliance,), np.array([compliance])))
    return tuple(out)


def _stiffness(log: Log, joint: str) -> float | None:
    """Stiffness of one transmission, None where the recording does not show it."""
    from identification.experiments.transmission_resonance import joint_response

    try:
        response = joint_response(log, joint)
        if np.mean(response.coherence >= rules.COHERENT) < rules.EXCITED_SHARE:
            return None
        from phantom_dyn.haptics.experiments.frequency_identification import fit_two_mass_of_instants

        # On its way a fit of what is no two-mass system may overflow; what it comes to is judged by its misfit.
        with np.errstate(all="ignore"):
            return fit_two_mass_of_instants(response).axis.cable_stiffness
    except (EstimationError, LogError, ParameterError):
        return None
