# pyright: reportAttributeAccessIssue=false
"""What is certainly wrong with a recording or with the model beside it, so that a diagnosis would mean nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from identification.data.recording import Fault, Recording
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.model.robot import Robot


def certain_faults(recording: Recording, robot: Robot) -> tuple[Fault, ...]:
    """All that is certainly wrong with a recording of one robot; nothing that may only be unusual.

    Args:
        recording: Raw samples.
        robot: The given model.
    """
    del recording  # so far the model alone is looked at
    return massless_model(robot)


def massless_model(robot: Robot) -> tuple[Fault, ...]:
    """A model that needs no torque for any motion: neither a link nor a rotor that moves has mass or inertia."""
    if np.any(standard_parameters(robot)) or np.any(robot.model.armature):
        return ()
    name = Path(robot.source).name if robot.source else robot.name
    return (
        Fault(
            f"no moving link of {name} has mass",
            "it needs no torque for any motion",
            f"give every link of {name} its mass and inertia (<inertial> in a URDF), or take a file that has them",
        ),
    )
