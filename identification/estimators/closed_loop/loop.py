"""Simulates recordings in closed loop: recorded references, stated controllers, a robot with estimated parameters.

The estimators that simulate closed loops start with the parameters of least squares (`start_of`). They use the
regressor on the simulated motion, as instruments (`iv`) or as the regressor of the fit (`didim`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Log
from identification.data.signals import align_held_torque
from identification.estimators.closed_loop.closed_loop_steps import Controllers, Trajectory, run
from identification.estimators.closed_loop.plant import (
    Plant,
    all_parameters,
    model_parameters,
    plant_of,
    require_simulable,
)
from identification.estimators.linear.least_squares import base_of, base_rows
from identification.estimators.weighted_least_squares import floored, wls
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import EstimationError, LogError, ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_STEP = 5e-4  # longest integration step [s], as in `phantom_dyn.simulation.simulate`
MOST_SIMULATIONS = 20
"""Largest number of simulations of the recordings in which the estimates have to converge."""


@dataclass(frozen=True)
class Feedback:
    """Position controllers ``tau = kp (q_ref - q) - kd v`` of all joints, in SI units on the joint side.

    Attributes:
        kp: Position gains, shape ``(nv,)``.
        kd: Velocity gains, shape ``(nv,)``.
        limit: Largest torques, infinite without a limit, shape ``(nv,)``.
        delay: Delay of the torque [s].
        held: True if the controllers compute a torque once per sample of the recording and hold it; False if they
            compute it continuously.
        window: Number of samples over which held controllers differentiate the position; 0 for the true velocity.
    """

    kp: Float[Array, " nv"]
    kd: Float[Array, " nv"]
    limit: Float[Array, " nv"]
    delay: float = 0.0
    held: bool = False
    window: int = 0

    def __post_init__(self):
        sizes = {np.shape(getattr(self, name)) for name in ("kp", "kd", "limit")}
        if len(sizes) != 1:
            raise ParameterError("kp, kd and limit differ in length: give one number of each for every joint.")
        for name in ("kp", "kd", "delay"):
            value = np.asarray(getattr(self, name))
            if not (np.isfinite(value).all() and (value >= 0).all()):
                raise ParameterError(f"{name} of the controllers is {value}: give numbers of 0 or more.")
        if not (np.asarray(self.limit) > 0).all():
            raise ParameterError(f"The torque limits of the controllers are {self.limit}: give numbers above 0.")
        if self.window < 0 or (self.window and not self.held):
            raise ParameterError("Only controllers that are held differentiate over samples: set held, or window 0.")


def feedback_of(robot: Robot) -> Feedback:
    """The controllers that ``robot.yaml`` states.

    Args:
        robot: The robot.

    Raises:
        ParameterError: If a joint with a drive has no controller, or one that cannot be simulated, or if the delays of
            the controllers differ.
    """
    joints = zip(robot.joint_names, robot.actuators, strict=True)
    lacking = [joint for joint, actuator in joints if actuator.actuated and actuator.controller is None]
    if lacking:
        raise ParameterError(
            f"The robot states no controller of {', '.join(lacking)}: add controller: {{kind: pd, kp: ..., kd: ...}} "
            "under joints in robot.yaml, or use an estimator without simulation, such as wls."
        )
    stated = [actuator.controller for actuator in robot.actuators]
    unknown = [
        joint
        for joint, controller in zip(robot.joint_names, stated, strict=True)
        if controller and (controller.reference_delay > 0 or np.isfinite(controller.limit))
    ]
    if unknown:
        raise ParameterError(
            f"The controllers of {', '.join(unknown)} have late references or shares of a supply, which the simulation "
            "does not know: use an estimator without simulation, such as wls."
        )
    delays = {controller.delay for controller in stated if controller is not None}
    if len(delays) > 1:
        raise ParameterError(f"The controllers are late by {sorted(delays)} s: the simulation wants one delay for all.")
    return Feedback(
        np.array([0.0 if controller is None else controller.kp for controller in stated]),
        np.array([0.0 if controller is None else controller.kd for controller in stated]),
        np.array([np.inf if a.torque_limit is None else a.torque_limit for a in robot.actuators]),
        delays.pop() if delays else 0.0,
        robot.torque_hold == "zoh",
    )


@dataclass(frozen=True)
class Loop:
    """One recording with its controllers.

    Attributes:
        log: The recording, ready for fitting; it has references.
        feedback: The controllers.
        steps: Integration steps per sample.
        align: True if the log's torque was shifted to the instants of its samples.
    """

    log: Log
    feedback: Feedback
    steps: int
    align: bool

    @property
    def dt(self) -> float:
        """Time between samples [s]."""
        return float(1.0 / self.log.band.rate_hz)


def loop_of(robot: Robot, log: Log, feedback: Feedback) -> Loop:
    """The closed loop of a log, after a check of its references.

    Args:
        robot: The robot of the log.
        log: One recording.
        feedback: The controllers.

    Raises:
        LogError: If the log has no finite references.
        ParameterError: If the number of controllers is not that of the joints.
    """
    if log.q_ref is None:
        raise LogError(
            f"{log.file} has no references: record q_ref.<joint> of every joint, or use an estimator without "
            "simulation, such as wls."
        )
    if not np.isfinite(log.q_ref).all():
        row, joint = np.argwhere(~np.isfinite(log.q_ref))[0]
        raise LogError(
            f"{log.file}: q_ref.{log.joint_names[joint]} is not finite at sample {row}: give a reference for every "
            "sample."
        )
    if len(feedback.kp) != robot.nv:
        raise ParameterError(f"There are {len(feedback.kp)} controllers for {robot.nv} joints: give one for each.")
    dt = 1.0 / log.band.rate_hz
    return Loop(log, feedback, max(1, int(np.ceil(dt / _STEP - 1e-9))), robot.torque_hold == "zoh")


def simulated(loop: Loop, plant: Plant) -> tuple[Motion, Float[Array, "N nv"]]:
    """Simulated motion and drive torque [N m or N], from the first recorded state on.

    Args:
        loop: Controllers and references.
        plant: The robot.

    Raises:
        EstimationError: If the simulation diverges.
    """
    log, feedback = loop.log, loop.feedback
    assert log.q_ref is not None
    wanted = np.ascontiguousarray(log.q_ref)
    controllers = Controllers(
        q_ref=wanted,
        gains=np.array([feedback.kp, feedback.kd, feedback.limit], dtype=float),
        window=feedback.window,
        delay=float(feedback.delay),
        held=feedback.held,
        dt=loop.dt,
        steps=loop.steps,
    )
    out = Trajectory(*(np.zeros(wanted.shape) for _ in range(4)))
    bad = run(plant, controllers, np.array(log.motion.q[0]), np.array(log.motion.v[0]), out)
    if bad >= 0:
        raise EstimationError(
            f"{log.file}: with the parameters of this step the robot does not move as a robot does after "
            f"{bad * loop.dt:.4g} s (an inertia that is not positive, controllers that are not stable, or "
            "links that cannot meet): check the controllers, or use an estimator without simulation, such as wls."
        )
    return Motion(log.motion.t, out.q, out.v, out.a), align_held_torque(out.tau) if loop.align else out.tau


def simulated_log(loop: Loop, plant: Plant) -> Log:
    """The log of the simulated robot, with the band and the valid samples of the recorded one.

    Args:
        loop: Controllers and references.
        plant: The robot.

    Raises:
        EstimationError: If the simulation diverges.
    """
    motion, tau = simulated(loop, plant)
    return replace(loop.log, motion=motion, tau=tau, raw_q=None)


@dataclass(frozen=True)
class Resimulation:
    """Simulation of all recordings with one set of parameters.

    Attributes:
        full: Values of all columns of the regressor.
        regressor: Equations on the simulated motion and the simulated torque.
    """

    full: Float[Array, " p"]
    regressor: Regressor

    def rows(self, base: BaseParameters) -> Float[Array, "N nv r"]:
        """Rows of the base parameters on the simulated motion."""
        return base_rows(self.regressor, base)


def loops_of(regressor: Regressor, feedback: Feedback | None) -> tuple[Loop, ...]:
    """The closed loops of the recordings of a regressor.

    Args:
        regressor: The equations, with robot and logs.
        feedback: The controllers; by default those of ``robot.yaml``.

    Raises:
        ParameterError: If robot or effects cannot be simulated, or a controller is not stated.
        LogError: If a log has no references.
    """
    require_simulable(regressor)
    stated = feedback_of(regressor.robot) if feedback is None else feedback
    return tuple(loop_of(regressor.robot, log, stated) for log in regressor.logs)


def resimulated(
    regressor: Regressor, loops: tuple[Loop, ...], base: BaseParameters, theta: Float[Array, " r"]
) -> Resimulation:
    """Simulation of the recordings by a robot with the given base parameters.

    Args:
        regressor: The equations, with robot, terms and recordings.
        loops: Recordings with their controllers.
        base: The unknowns.
        theta: Values of the unknowns.

    Raises:
        EstimationError: If the simulation diverges.
    """
    plant = plant_of(regressor, base, theta)
    logs = tuple(simulated_log(loop, plant) for loop in loops)
    return Resimulation(all_parameters(regressor, base, theta), replace(regressor, logs=logs))


@dataclass(frozen=True)
class Start:
    """A first simulation of all recordings.

    Attributes:
        loops: Recordings with their controllers.
        simulation: Simulation with the parameters of least squares; if it diverges, with those of the given robot.
        base: Base parameters that the simulated motion excites. Noise of the recorded motion can excite further ones.
        theta: Values of the base parameters in the simulated robot.
        weights: One over the noise of each joint, from the residual of least squares.
    """

    loops: tuple[Loop, ...]
    simulation: Resimulation
    base: BaseParameters
    theta: Float[Array, " r"]
    weights: Float[Array, " nv"]


def start_of(regressor: Regressor, feedback: Feedback | None) -> Start:
    """The first simulation of the recordings of a regressor.

    Args:
        regressor: The equations.
        feedback: The controllers; by default those of ``robot.yaml``.

    Raises:
        LogError: If a log has no references.
        ParameterError: If a controller is not stated, or robot or effects cannot be simulated.
        IdentifiabilityError: If the recording excites no parameter, or has too few equations to estimate the noise.
        EstimationError: If the simulation diverges both with the parameters of least squares and with the given ones.
    """
    loops = loops_of(regressor, feedback)
    first = wls(regressor)
    try:
        simulation = resimulated(regressor, loops, first.base, first.theta)
    except EstimationError:
        simulation = resimulated(regressor, loops, first.base, first.base.values(model_parameters(regressor)))
    base = base_of(simulation.regressor)
    weights = 1.0 / floored(first.sigma, regressor)
    return Start(loops, simulation, base, base.values(simulation.full), weights)


def not_settled() -> EstimationError:
    """The error of an estimator that does not converge."""
    return EstimationError(
        f"The estimates did not settle within {MOST_SIMULATIONS} simulations: check references, controllers and the "
        "delay."
    )
