"""A small figure for each effect: the drive torque that it leaves beyond the model's, over velocity, position, time.

Drawn by the effect's own law on one motion of one joint of a simulated arm. An effect that leaves no torque in inverse
dynamics has the error of its readings instead.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.operation import Operation, References
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

ARM = Path(__file__).resolve().parents[1] / "examples" / "data" / "arm" / "arm.urdf"
JOINT = "elbow"
PERIOD, SWING, CENTER = 2.0, 0.8, 0.3  # s, rad, rad
GAIN = 100.0  # N m/rad, of the controller whose reference may be late
SIZES: dict[str, float | list[float]] = {
    "coefficient": 0.2,
    "coefficient_positive": 0.3,
    "coefficient_negative": 0.1,
    "torque": 0.5,
    "torque_positive": 0.6,
    "torque_negative": 0.3,
    "coulomb_torque": 0.3,
    "static_torque": 0.8,
    "stribeck_velocity": 0.4,
    "torque_slope": -0.005,
    "coefficient_slope": 0.0,
    "ratio": 1.3,
    "inertia": 0.05,
    "mass": 0.4,
    "center_x": 0.2,
    "center_y": 0.0,
    "center_z": 0.0,
    "mx": 0.05,
    "stiffness": 20.0,
    "rest_position": 0.3,
    "displacement": 0.05,
    "position": 0.0,
    "limit": 0.65,
    "delay": 0.02,
    "time_constant": 0.02,
    "gap": 0.02,
    "roll": 0.05,
    "pitch": 0.05,
    "offset": 0.05,
    "amplitude": 0.02,
    "phase": 0.0,
    "step": 0.1,
}
"""By the name of the parameter; those that are not here have their default, or a third of a unit."""
LISTS: dict[str, list[float]] = {
    "position": [-0.5, 0.0, 0.5, 1.1],
    "torque": [0.2, 0.6, 0.3, 0.7],
    "order": [12.0],
    "amplitude": [0.2],
    "phase": [0.0],
}
"""The same for parameters that are lists."""


def smooth_arm() -> Robot:
    """The arm of the first diagnosis without the friction of its file, whose steps would hide small effects."""
    robot = load_robot(ARM)
    return replace(robot, viscous_friction=np.zeros(robot.nv), coulomb_friction=np.zeros(robot.nv))


def swung(robot: Robot) -> Operation:
    """One joint along a sine, its drive warmed by 60 degrees on the way, its torque asked for by a controller.

    The time before 0 is not drawn: springs settle there.
    """
    t = np.linspace(-PERIOD, 2 * PERIOD, 900)
    row = robot.joint_names.index(JOINT)
    q, v, a = (np.zeros((len(t), robot.nv)) for _ in range(3))
    w = 2 * np.pi / PERIOD
    q[:, row] = CENTER + SWING * np.sin(w * t)
    v[:, row], a[:, row] = SWING * w * np.cos(w * t), -SWING * w**2 * np.sin(w * t)
    warm = np.repeat(np.linspace(0.0, 60.0, len(t))[:, None], robot.nv, axis=1)
    operation = Operation.of(robot, Motion(t, q, v, a), temperature=warm)
    gain, free = np.full(robot.nv, GAIN), np.full(robot.nv, np.inf)
    references = References(t, q + operation.tau / GAIN, operation.tau, gain, free, np.zeros(robot.nv), free)
    return replace(operation, references=references)


def shown_size(parameter: Parameter) -> float | list[float]:
    """A size that shows the law, possible and at most what a sound device may have."""
    name = parameter.name.rpartition(".")[2]
    if parameter.listed:
        return LISTS[name]
    size = SIZES.get(name, 1.0 / 3.0 if parameter.default is None else parameter.default)
    assert isinstance(size, float)
    most = parameter.upper if parameter.plausible is None else parameter.plausible[1]
    return float(np.clip(size, parameter.lower, most))


def shown_place(effect: Effect, robot: Robot) -> str | None:
    """Where it sits in the figure: on the joint that moves, on a pair that ends there, or on the whole robot."""
    if effect.scope == "either":
        return JOINT
    return next(place for place in effect.places(robot) if place is None or place.split("+")[-1] == JOINT)


def shown_sizes(effect: Effect) -> str:
    """The sizes of the figure in words, those that are not zero."""
    robot = smooth_arm()
    sizes = {one: shown_size(one) for one in effect.parameters(robot, shown_place(effect, robot))}
    parts = [
        f"{one.name} {', '.join(f'{value:g}' for value in np.atleast_1d(size))} {one.unit if one.unit != '1' else ''}"
        for one, size in sizes.items()
        if np.any(size)
    ]
    return "; ".join(part.strip() for part in parts)


def left_by(effect: Effect, operation: Operation) -> tuple[np.ndarray, str]:
    """What an effect leaves at the joint, and the label of that."""
    robot = operation.robot
    place = shown_place(effect, robot)
    sizes = [shown_size(parameter) for parameter in effect.parameters(robot, place)]
    theta = np.concatenate([np.atleast_1d(size) for size in sizes])
    row = robot.joint_names.index(JOINT)
    left = -effect.torque(robot, operation, place, theta)[:, row]
    if left.any():
        return left, "torque beyond\nthe model's [N m]"
    reading = effect.simulated(robot, place, theta).reading
    assert reading is not None, f"{effect.name} leaves neither torque nor an error of the readings"
    return np.array([reading(q)[row] - q[row] for q in operation.q]), "reading beyond\nthe position [rad]"


def effect_figure(effect: Effect, operation: Operation) -> Figure:
    """What an effect leaves, over velocity, position and time."""
    settled = operation.t >= 0
    left, label = left_by(effect, operation)
    left = left[settled]
    row = operation.robot.joint_names.index(JOINT)
    out = Figure(figsize=(8.0, 1.9))
    abscissas = {
        "velocity [rad/s]": operation.v[settled, row],
        "position [rad]": operation.q[settled, row],
        "time [s]": operation.t[settled],
    }
    for ax, (words, x) in zip(out.subplots(1, 3, sharey=True), abscissas.items(), strict=True):
        ax.plot(x, left, color="#0072B2", lw=1.2)
        ax.axhline(0.0, color="0.7", lw=0.8, zorder=0)
        ax.set_xlabel(words, fontsize=8)
        ax.tick_params(labelsize=7)
    out.axes[0].set_ylabel(label, fontsize=8)
    out.subplots_adjust(left=0.11, right=0.99, bottom=0.22, top=0.97, wspace=0.06)
    largest = max(float(np.abs(left).max()), 1e-12)
    out.axes[0].set_ylim(-1.15 * largest, 1.15 * largest)
    return out


def write_figures(folder: Path, effects: tuple[Effect, ...]) -> None:
    """Write ``effect_NAME.svg`` for every effect."""
    operation = swung(smooth_arm())
    with mpl.rc_context({"svg.hashsalt": "effects"}):
        for effect in effects:
            effect_figure(effect, operation).savefig(folder / f"effect_{effect.name}.svg", metadata={"Date": None})
