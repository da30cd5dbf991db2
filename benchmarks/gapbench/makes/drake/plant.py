"""Mass matrix, bias and inverse dynamics of a robot, all from Drake's MultibodyPlant."""

from __future__ import annotations

from typing import Any

import numpy as np

from .engine import drake
from .files import urdf
from .robots import Robot


class Plant:
    """A robot in Drake, without drives and friction: those belong to the steps of the simulation.

    A class, since Drake evaluates in a context that it changes.
    """

    def __init__(self, robot: Robot) -> None:
        plant = drake("multibody.plant").MultibodyPlant(0.0)
        drake("multibody.parsing").Parser(plant).AddModelsFromString(urdf(robot, friction=False), "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        last = plant.GetBodyByName(f"{robot.parts[-1].joint}_part")
        loads = {"payload": robot.payload, "carried": robot.carried}
        for name, (mass, place) in ((name, load) for name, load in loads.items() if load is not None):
            tree = drake("multibody.tree")
            point = tree.SpatialInertia(mass, np.zeros(3), tree.UnitInertia.SolidSphere(1e-4))
            load = plant.AddRigidBody(name, plant.GetModelInstanceByName(robot.kind), point)
            pose = drake("math").RigidTransform(np.array(place))
            plant.WeldFrames(last.body_frame(), load.body_frame(), pose)
        plant.mutable_gravity_field().set_gravity_vector(np.array(robot.gravity))
        plant.Finalize()
        self.size = len(robot.parts)
        order = [plant.GetJointByName(part.joint).velocity_start() for part in robot.parts]
        if order != list(range(self.size)):
            raise RuntimeError(f"Drake orders the joints of {robot.kind} as {order}: a chain from the base is wanted.")
        self._plant: Any = plant
        self._context: Any = plant.CreateDefaultContext()
        self._no_forces: Any = drake("multibody.tree").MultibodyForces(plant)

    def equation(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix M, shape ``(n, n)``, and h of M a + h = torque, shape ``(n,)``.

        Raises:
            FloatingPointError: If the motion has run away; Drake would end the process.
        """
        plant, context = self._plant, self._context
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise FloatingPointError("The motion has run away.")
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
        return plant.CalcMassMatrix(context), bias

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Drake's inverse dynamics with gravity, over samples, shape ``(N, n)``."""
        plant, context, forces = self._plant, self._context, self._no_forces
        out = np.empty_like(q)
        for k in range(len(q)):
            plant.SetPositions(context, q[k])
            plant.SetVelocities(context, v[k])
            out[k] = plant.CalcInverseDynamics(context, a[k], forces) - plant.CalcGravityGeneralizedForces(context)
        return out

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        """Kinetic and potential energy [J]."""
        self._plant.SetPositions(self._context, q)
        self._plant.SetVelocities(self._context, v)
        potential = self._plant.CalcPotentialEnergy(self._context)
        return float(potential + self._plant.CalcKineticEnergy(self._context))
