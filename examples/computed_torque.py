"""Teleoperation of two PHANToMs by computed torque: how the acceleration of the master is known decides the error.

The paper on the PHANToM plans it for finer encoders or accelerometers, as "differentiating the already noisy and
delayed velocity measurements is not feasible" (section 7). A hand moves the master along sines; the slave gets

    tau = M(q) (a_master + Kd (v_master - v) + Kp (q_master - q)) + C(q, v) v + N(q)

at 1 kHz from readings in encoder steps, by the corrected closed form of section 3. Motion, gains, windows and the noise
of the accelerometers are not published and are assumed here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from arguments import chosen_folder
from matplotlib.figure import Figure

from phantom_dyn.devices.phantom import PHANTOM_1_5, coriolis_matrix, gravity_torque, mass_matrix, tip_position
from phantom_dyn.haptics.figures.canvas import COLORS, key, panels
from phantom_dyn.haptics.sensing.encoder import PHANTOM_STEP

PERIOD, DURATION, STEPS = 1e-3, 1.2, 4
SETTLED = 0.5  # s
FREQUENCY = 2 * math.pi * np.array([1.5, 2.5, 2.0])  # rad/s
AMPLITUDE = np.array([0.25, 0.15, 0.2])  # rad
BANDWIDTH = 2 * math.pi * 8.0  # rad/s, critically damped
ACCELEROMETER_NOISE = 0.05  # m/s2
JOINT_STEP = PHANTOM_STEP / PHANTOM_1_5.l1  # rad


@dataclass(frozen=True)
class Sensing:
    """How positions and the master's acceleration are read.

    Attributes:
        step: Of the encoders [rad].
        window: Samples over which velocities, and accelerations without accelerometers, are differences.
        acceleration: ``none``, ``differences`` or ``accelerometers``.
    """

    step: float
    window: int
    acceleration: str


WAYS = {
    "no acceleration": Sensing(JOINT_STEP, 16, "none"),
    "differences of the stock encoders": Sensing(JOINT_STEP, 16, "differences"),
    "differences of sinusoidal encoders, 64 times finer": Sensing(JOINT_STEP / 64, 4, "differences"),
    "accelerometers": Sensing(JOINT_STEP, 16, "accelerometers"),
}


def master(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions [rad] and accelerations [rad/s2] of the master at times, shape ``(N, 3)``."""
    phase = np.outer(t, FREQUENCY)
    return AMPLITUDE * np.sin(phase), -AMPLITUDE * FREQUENCY**2 * np.sin(phase)


@dataclass(frozen=True)
class Followed:
    """A run: times [s], the error of the slave's tip [m] at each, and its root mean square once it has settled."""

    t: np.ndarray
    error: np.ndarray

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.error[self.t >= SETTLED] ** 2)))


def follow(sensing: Sensing) -> Followed:
    """The slave follows the master, simulated with four steps of the mechanics in a period of the controller."""
    rng = np.random.default_rng(1)
    t = PERIOD * np.arange(round(DURATION / PERIOD))
    wanted, a_master = master(t)
    read = np.round(wanted / sensing.step) * sensing.step
    if sensing.acceleration == "accelerometers":
        known = a_master + ACCELEROMETER_NOISE / PHANTOM_1_5.l1 * rng.standard_normal(a_master.shape)
    else:
        known = _second_difference(read, sensing.window) * (sensing.acceleration == "differences")
    v_master = _difference(read, sensing.window)
    q, v = np.zeros((1, 3)), AMPLITUDE[None] * FREQUENCY
    positions, readings = np.zeros((len(t), 3)), _with_past(np.zeros((len(t), 3)), sensing.window)
    for k in range(len(t)):
        positions[k] = q
        there = np.round(q / sensing.step) * sensing.step
        readings[k + sensing.window] = there
        v_read = (there - readings[k]) / (sensing.window * PERIOD)
        pull = BANDWIDTH**2 * (read[k] - there) + 2 * BANDWIDTH * (v_master[k] - v_read)
        torque = np.einsum("nij,nj->ni", mass_matrix(there), known[k] + pull) + gravity_torque(there)
        torque += np.einsum("nij,nj->ni", coriolis_matrix(there, v_read), v_read)
        for _ in range(STEPS):
            v = v + PERIOD / STEPS * _acceleration(q, v, torque)
            q = q + PERIOD / STEPS * v
    return Followed(t, np.linalg.norm(tip_position(positions) - tip_position(wanted), axis=1))


def _acceleration(q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
    rest = torque - gravity_torque(q) - np.einsum("nij,nj->ni", coriolis_matrix(q, v), v)
    return np.linalg.solve(mass_matrix(q), rest[..., None])[..., 0]


def _with_past(q: np.ndarray, window: int) -> np.ndarray:
    """Positions with those of a window before the first one, where the motion went along its first slope."""
    past = -PERIOD * AMPLITUDE * FREQUENCY * np.arange(window, 0, -1)[:, None]
    return np.concatenate([past, q])


def _difference(q: np.ndarray, window: int) -> np.ndarray:
    """Velocity over a window."""
    past = _with_past(q, window)
    return (past[window:] - past[:-window]) / (window * PERIOD)


def _second_difference(q: np.ndarray, window: int) -> np.ndarray:
    """Acceleration over two windows."""
    v = _difference(q, window)
    past = np.concatenate([np.repeat(v[:1], window, axis=0), v])
    return (past[window:] - past[:-window]) / (window * PERIOD)


def errors_in_time(runs: dict[str, Followed]) -> Figure:
    title = "Teleoperation of two PHANToMs by computed torque, by how the master's acceleration is known"
    out, ((ax,),) = panels(1, title=title, height=3.6)
    for k, (words, run) in enumerate(runs.items()):
        ax.plot(run.t, 1e3 * run.error, color=COLORS[k], label=f"{words}: {1e3 * run.rms:.2f} mm rms")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("error of the slave's tip [mm]")
    key(ax, "upper right")
    return out


def main(folder: Path) -> None:
    runs = {words: follow(sensing) for words, sensing in WAYS.items()}
    for words, run in runs.items():
        print(f"{words:<52} {1e3 * run.rms:.3f} mm rms")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "computed_torque.png"
    errors_in_time(runs).savefig(path)
    print(f"wrote {path}")


if __name__ == "__main__":
    main(chosen_folder(__doc__, "papers"))
