"""A run: a controller at uneven ticks, a drive, bristles and Drake's equation of motion between the ticks.

Each step moves positions by half of it, solves for the speeds at its end with friction and transmission implicit, and
moves positions by the other half: second order in the step, and stable however stiff bristles and flanks are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bristles import linear
from .contacts import Fine, contacts
from .departures import Departures
from .drive import CommandHistory, passed, ripple, sensed
from .motions import Motion
from .outside import SAG_SPEED, more_dry, of_drive, on_link
from .plant import Plant
from .robots import Robot, encoder_step

STEP = 5e-4  # longest step between ticks [s]
FLANK = 2.0 * np.pi * 120.0  # resonance of a tooth flank against the lighter side [rad/s]
EXACT = 1e-6  # of a count
SPRING_DAMPING = 0.03  # of critical
FLANK_DAMPING = 0.3


@dataclass(frozen=True)
class Session:
    """All that two runs of a pair share.

    Attributes:
        motion: Reference at the ticks.
        feedforward: Torque of the given model for it [N m], shape ``(N, n)``.
        stiffness, damping: Gains of the controller, shape ``(n,)``.
        noise: Torque that no log holds, held from tick to tick [N m], shape ``(N, n)``.
        fine: What belongs to the robot of a null too.
    """

    motion: Motion
    feedforward: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    noise: np.ndarray
    fine: Fine


@dataclass(frozen=True)
class Run:
    """What happened, at the ticks; arrays of shape ``(N, n)``.

    Attributes:
        t: [s], shape ``(N,)``.
        reading: Of the encoders.
        shown: The same before it is rounded to the stated counts.
        command: As logged [N m].
        motor: True motor angles.
        speed: True motor speeds.
    """

    t: np.ndarray
    reading: np.ndarray
    shown: np.ndarray
    command: np.ndarray
    motor: np.ndarray
    speed: np.ndarray


@dataclass(frozen=True)
class Flex:
    """Transmissions that give: joints, spring, damping and full play, each of shape ``(m,)``."""

    joints: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    gap: np.ndarray

    def force(self, twist: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Torque at this twist and its slope over the speed of twisting at the end of the step."""
        over = np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * self.gap, 0.0)
        touching = over != 0.0
        return self.stiffness * over, np.where(touching, 0.5 * step * self.stiffness + self.damping, 0.0)


def transmission(of: Departures, rotor: np.ndarray, link: np.ndarray) -> Flex:
    """Springs as they were drawn; a play closes on flanks that ring at `FLANK`.

    Args:
        rotor: [kg m^2], shape ``(n,)``.
        link: Inertia about each joint [kg m^2], shape ``(n,)``.
    """
    j = of.loose
    both = rotor[j] * link[j] / (rotor[j] + link[j])
    sprung = of.stiffness[j] > 0.0
    stiffness = np.where(sprung, of.stiffness[j], both * FLANK**2)
    damping = 2.0 * np.where(sprung, SPRING_DAMPING, FLANK_DAMPING) * np.sqrt(stiffness * both)
    return Flex(j, stiffness, damping, of.gap[j])


class _Machine:
    """Positions, speeds and bends of a robot while it moves; a class, since every step changes them."""

    def __init__(self, robot: Robot, of: Departures, session: Session) -> None:
        n = len(robot.parts)
        self.n, self.of, self.session, self.plant = n, of, session, Plant(robot)
        start = session.motion.q[0]
        mass, bias = self.plant.equation(start, np.zeros(n))
        rotor = robot.array("rotor") + of.rotor
        self.flex = transmission(of, rotor, np.diag(mass))
        loose = self.flex.joints
        self.motor = np.arange(n)
        self.motor[loose] = n + np.arange(len(loose))
        self.size = n + len(loose)
        self.contacts = contacts(robot, of, session.fine, self.motor)
        self.twisting = np.eye(self.size)[self.motor[loose]] - np.eye(self.size)[loose]
        self.fixed = np.zeros((self.size, self.size))
        self.fixed[self.motor, self.motor] = rotor
        if of.coupling is not None:
            row = self.contacts.rows[-1]
            self.fixed += of.coupling.inertia * np.outer(row, row)
        self.q = np.concatenate([start, start[loose]])
        # A spring starts under the load that it carries, a play on the flank that carries it.
        wound = bias[loose] / self.flex.stiffness + 0.5 * self.flex.gap * np.sign(bias[loose])
        self.q[n:] += wound
        self.u, self.acceleration = np.zeros(self.size), np.zeros(self.size)
        self.bend = np.zeros(len(self.contacts.rows))
        # The drives have followed the first command for a while already.
        self.lagged = self.slow = session.feedforward[0].copy()
        self.load, self.usual = 0.0, max(float(np.abs(session.feedforward).sum(axis=1).mean()), 1e-9)
        self.through = bias
        self.loop = session.fine.loop

    def torque(self, history: CommandHistory, t: float, step: float, noise: np.ndarray) -> np.ndarray:
        """What the drives give over this step [N m], shape ``(n,)``."""
        of = self.of
        wanted = history.mean(t, t + step, of.delay) if of.delay.any() else history.held
        wanted, self.lagged = passed(self.lagged, wanted, self.loop, step)
        wanted, self.slow = passed(self.slow, wanted, of.lag, step)
        q = self.q[self.motor]
        self.load += step / SAG_SPEED * (float(np.abs(wanted).sum()) / self.usual - self.load)
        given = of_drive(of.outside, of.ratio * wanted, q, self.load)
        return np.clip(given, -of.limit, of.limit) + of.offset + ripple(of, q) + noise

    def step(self, torque: np.ndarray, t: float, step: float) -> None:
        """Moves on by one step under these drive torques."""
        n, of, rows, flex = self.n, self.of, self.contacts.rows, self.flex
        q = self.q + 0.5 * step * self.u
        middle = self.u + 0.5 * step * self.acceleration
        mass, bias = self.plant.equation(q[:n], middle[:n])
        matrix = self.fixed.copy()
        matrix[:n, :n] += mass
        force = np.zeros(self.size)
        force[:n] = on_link(of.outside, t, q[:n], middle[:n]) - bias
        force[:n] -= of.spring[:, 0] * (q[:n] - of.spring[:, 1])
        force[self.motor] += torque
        slip = rows @ self.u
        level = self.contacts.bristles.level(slip)
        level[:n] += of.load * np.abs(self.through) + more_dry(of.outside, t, n)
        np.maximum(level, 1e-9, out=level)
        rubbing = linear(self.contacts.bristles, self.bend, slip, step, level)
        force -= rows.T @ rubbing.offset
        matrix_now = matrix + step * (rows.T * rubbing.slope) @ rows
        if len(flex.joints):
            held, slope = flex.force(self.twisting @ q, step)
            force -= self.twisting.T @ held
            matrix_now += step * (self.twisting.T * slope) @ self.twisting
        new = np.linalg.solve(matrix_now, matrix @ self.u + step * force)
        self.acceleration = (new - self.u) / step
        self.bend = rubbing.next_bend(self.bend, rows @ new)
        if of.load.any():
            # What the links take: without the rotors, which turn on this side of the transmission.
            self.through = mass @ self.acceleration[:n] + bias
        self.u, self.q = new, q + 0.5 * step * new


def simulated(robot: Robot, of: Departures, session: Session) -> Run:
    """Runs the robot through the session's motion under its controller."""
    machine, motion, n = _Machine(robot, of, session), session.motion, len(robot.parts)
    t, units = motion.t, np.array([encoder_step(part) for part in robot.parts])
    history = CommandHistory(t, n)
    shape = (len(t), n)
    reading, shown, command, motor, speed = (np.zeros(shape) for _ in range(5))
    rate = np.zeros(n)
    for k in range(len(t)):
        motor[k], speed[k] = machine.q[machine.motor], machine.u[machine.motor]
        reading[k], shown[k] = sensed(of, motor[k], units), sensed(of, motor[k], EXACT * units)
        if k:
            period = t[k] - t[k - 1]
            # Speed as drives make it: differences of counts through a low pass of 3 ms.
            rate += period / (period + 3e-3) * ((reading[k] - reading[k - 1]) / period - rate)
        feedback = session.stiffness * (motion.q[k] - reading[k]) + session.damping * (motion.v[k] - rate)
        command[k] = session.feedforward[k] + feedback
        history.hold(k, command[k])
        if k + 1 == len(t):
            break
        count = int(np.ceil((t[k + 1] - t[k]) / STEP - 1e-9))
        step = (t[k + 1] - t[k]) / count
        for i in range(count):
            now = t[k] + i * step
            machine.step(machine.torque(history, now, step, session.noise[k]), now, step)
        if not np.isfinite(machine.u).all():
            raise FloatingPointError("The run diverged.")
    return Run(t, reading, shown, command, motor, speed)
