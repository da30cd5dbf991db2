"""Simulate servos on a bus from their equations, and write recordings, robot files and true causes.

This module does not import phantom_dyn or identification. An arm of one or two links moves in a vertical plane. The
servo of each joint has a loop of its own: ``u = clip(k (reference - position))`` at 1 kHz from encoder counts, torque
``kt (u - kt v) / R``. References arrive with a delay over a bus of 30 to 100 Hz, and each acts until the next. The bus
logs positions and references once per frame. As voltage it logs what the servo applies at that moment
(``measured``), or what the logger computes from reference and position (``command``), or nothing (``motion``).
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np
from numba import njit

Array = np.ndarray

G = 9.81
STEP = 2.5e-4  # integration step [s]
LOOP = 4  # integration steps in one step of the servo's loop
COUNTS = 4096


@dataclass(frozen=True)
class Arm:
    """Uniform rods in a vertical plane that hang down at zero, with rotors on the joint side.

    Attributes:
        mass, length: Of each link [kg], [m].
        rotor: Inertias [kg m^2].
        tip: Mass at the end of the last link [kg].
    """

    mass: Array
    length: Array
    rotor: Array
    tip: float = 0.0


@dataclass(frozen=True)
class Servo:
    """One drive and its position loop.

    Attributes:
        gain: Volts per rad of position error.
        kt, resistance: Torque constant at the joint [N m/A] and resistance [ohm].
        supply: Largest voltage.
        delay: Time [s] from the bus's sample to when the reference acts.
        coulomb, viscous: Friction [N m], [N m s/rad].
        by_load: Friction per torque that the transmission passes on.
        sag: Volts that the supply loses per ampere of all drives.
        drops_beyond: Position error [rad] beyond which the servo protects itself; infinite without protection.
        drops_to: Largest share of the supply in that case.
        warms: Kelvin per second by which the motor warms from 25 deg C; the resistance of copper grows by 0.393 % each.
    """

    gain: float
    kt: float = 1.08
    resistance: float = 1.3
    supply: float = 12.0
    delay: float = 0.0
    coulomb: float = 0.0
    viscous: float = 0.0
    by_load: float = 0.0
    sag: float = 0.0
    drops_beyond: float = np.inf
    drops_to: float = 1.0
    warms: float = 0.0


@dataclass(frozen=True)
class Case:
    """The files of a case, and its true causes.

    Attributes:
        kind: Name of the recipe.
        truth: Size of the first parameter by effect; empty for a null.
        robot: URDF of the given model.
        config: Its robot.yaml.
        log: CSV.
        flags: Of the command line.
    """

    kind: str
    truth: dict[str, float]
    robot: str
    config: str
    log: str
    flags: tuple[str, ...] = ()

    def write(self, folder: Path) -> tuple[Path, Path, Path]:
        """Write robot, robot.yaml and log into a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        paths = folder / "robot.urdf", folder / "robot.yaml", folder / "log.csv"
        for path, text in zip(paths, (self.robot, self.config, self.log), strict=True):
            path.write_text(text, encoding="utf-8")
        return paths


@njit(cache=True)
def _bias(q, v, mass, length, rotor, tip, matrix):
    """Torque of gravity and velocities for relative joint angles; the mass matrix is written into ``matrix``."""
    out = np.zeros(len(q))
    if len(q) == 1:
        matrix[0, 0] = mass[0] * length[0] ** 2 / 3 + tip * length[0] ** 2 + rotor[0]
        out[0] = G * np.sin(q[0]) * (mass[0] * length[0] / 2 + tip * length[0])
        return out
    # In absolute angles; the joint angles are q1 = a1 and q2 = a2 - a1, so the torques add up.
    a1, a2, w1, w2 = q[0], q[0] + q[1], v[0], v[0] + v[1]
    first = mass[0] * length[0] ** 2 / 3 + (mass[1] + tip) * length[0] ** 2
    second = mass[1] * length[1] ** 2 / 3 + tip * length[1] ** 2
    shared = length[0] * (mass[1] * length[1] / 2 + tip * length[1])
    c, s = np.cos(a2 - a1), np.sin(a2 - a1)
    b1 = -shared * s * w2**2 + G * np.sin(a1) * (mass[0] * length[0] / 2 + (mass[1] + tip) * length[0])
    b2 = shared * s * w1**2 + G * np.sin(a2) * (mass[1] * length[1] / 2 + tip * length[1])
    matrix[0, 0] = first + 2 * shared * c + second + rotor[0]
    matrix[0, 1] = matrix[1, 0] = second + shared * c
    matrix[1, 1] = second + rotor[1]
    out[0], out[1] = b1 + b2, b2
    return out


@njit(cache=True)
def _stepped(t, q_ref, mass, length, rotor, tip, numbers):
    """Readings, voltages, shares of the supply, and the supply at the bus's samples."""
    gain, kt, resistance, nominal, delay, coulomb, viscous, by_load, sag, beyond, drops_to, warms = numbers
    n, count = q_ref.shape[1], 2 * np.pi / COUNTS
    read, out, share = np.zeros((len(t), n)), np.zeros((len(t), n)), np.zeros((len(t), n))
    level = np.zeros(len(t))
    q, v, u, duty, supply = q_ref[0].copy(), np.zeros(n), np.zeros(n), np.zeros(n), nominal
    matrix, rub, slope, drive = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n)
    k, active, i = 0, 0, 0
    while True:
        time = t[0] + i * STEP
        while active + 1 < len(t) and t[active + 1] + delay <= time + 1e-12:
            active += 1
        if i % LOOP == 0:
            for j in range(n):
                error = q_ref[active, j] - np.round(q[j] / count) * count
                most = drops_to if abs(error) > beyond else 1.0
                # The register has the duty in thousandths of the supply.
                duty[j] = np.round(1000 * min(max(gain * error / nominal, -most), most)) / 1000
        u = duty * supply
        while k < len(t) and t[k] <= time + 1e-12:
            read[k], out[k], share[k], level[k] = np.round(q / count) * count, u, duty, supply
            k += 1
        if k == len(t):
            return read, out, share, level
        h = STEP / 2
        for _ in range(2):
            current = (u - kt * v) / (resistance * (1.0 + 0.00393 * warms * (time - t[0])))
            supply = nominal - sag * np.sum(np.abs(current * duty))
            bias = _bias(q, v, mass, length, rotor, tip, matrix)
            for j in range(n):
                drive[j] = kt * current[j]
                # Load-dependent friction is computed with the drive's torque: the rotor's share of it is small.
                rubbing = coulomb + by_load * abs(drive[j])
                soft = np.tanh(v[j] / 0.01)
                rub[j] = viscous * v[j] + rubbing * soft
                slope[j] = viscous + rubbing * (1 - soft**2) / 0.01
            # Implicit in the steep part of friction.
            a = np.linalg.solve(matrix + h * np.diag(slope), drive - bias - rub)
            v = v + h * a
            q = q + h * v
        i += 1


def simulated(arm: Arm, servo: Servo, t: Array, q_ref: Array) -> tuple[Array, Array, Array, Array]:
    """Readings, voltages, share of the supply and supply at the bus's samples.

    Args:
        arm: True arm.
        servo: Servo of every joint.
        t: Times of the bus [s].
        q_ref: References that are sent at these times, ``(N, n)``.
    """
    numbers = np.array([float(x) for x in astuple(servo)])
    return _stepped(t, q_ref, arm.mass, arm.length, arm.rotor, float(arm.tip), numbers)


def reference(rng: np.random.Generator, t: Array, joints: int) -> Array:
    """Sines of three frequencies and sections of triangles, ``(N, joints)``."""
    out = np.zeros((len(t), joints))
    for j in range(joints):
        f = rng.uniform([0.1, 0.35, 0.8], [0.25, 0.6, 1.2])
        size, phase = np.array([0.7, 0.35, 0.12]), rng.uniform(0, 2 * np.pi, 3)
        out[:, j] = (size * np.sin(2 * np.pi * f * t[:, None] + phase)).sum(axis=1)
        out[:, j] += 0.3 * (2 * np.abs((t * rng.uniform(0.12, 0.2)) % 1.0 - 0.5) - 0.5)
    return out


def urdf(arm: Arm) -> str:
    """Model of an arm: rods, and a mass at the tip if it has one."""
    links, joints = ['<link name="base"/>'], []
    for j, (m, span) in enumerate(zip(arm.mass, arm.length, strict=True)):
        tip = arm.tip if j == len(arm.mass) - 1 else 0.0
        whole = m + tip
        centre = (m * span / 2 + tip * span) / whole
        about = m * span**2 / 3 + tip * span**2 - whole * centre**2
        links.append(
            f'<link name="l{j}"><inertial><origin xyz="0 0 {-centre:.9g}"/><mass value="{whole:.9g}"/>'
            f'<inertia ixx="{about:.9g}" iyy="{about:.9g}" izz="{max(0.02 * about, 1e-7):.9g}" '
            'ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )
        place = 0.0 if j == 0 else -arm.length[j - 1]
        joints.append(
            f'<joint name="j{j}" type="revolute"><parent link="{"base" if j == 0 else f"l{j - 1}"}"/>'
            f'<child link="l{j}"/><origin xyz="0 0 {place:.9g}"/><axis xyz="0 -1 0"/>'
            '<limit lower="-3.2" upper="3.2" effort="12" velocity="12"/></joint>'
        )
    return '<robot name="servo_arm">' + "".join(links + joints) + "</robot>\n"


def table(columns: dict[str, Array]) -> str:
    """CSV of columns."""
    rows = np.column_stack(list(columns.values()))
    return ",".join(columns) + "\n" + "\n".join(",".join(f"{x:.6g}" for x in row) for row in rows) + "\n"


KINDS = (
    "null measured", "null command", "null motion", "late command", "late motion", "load measured", "load command",
    "load motion", "friction measured", "friction command", "sag", "protection",
    "warm", "protection load",
)  # fmt: skip


def case(kind: str, seed: int) -> Case:
    """One case; equal seeds give equal cases.

    Args:
        kind: One of `KINDS`.
        seed: Seed of all random numbers.
    """
    rng = np.random.default_rng([KINDS.index(kind), seed])
    joints = 1 if rng.random() < 0.6 else 2
    what, *rest = kind.split(" ")
    loaded = "load" in (what, *rest)
    route = next((word for word in rest if word != "load"), "measured")
    rate = float(rng.choice([30.0, 50.0, 60.0, 100.0])) if route != "measured" else float(rng.choice([50.0, 100.0]))
    t = np.arange(int((24.0 if rate < 60 else 16.0) * rate)) / rate
    length = rng.uniform(0.12, 0.2, joints)
    given = Arm(rng.uniform(0.25, 0.6, joints), length, rng.uniform(0.006, 0.015, joints))
    off = 1.0 + 0.03 * rng.standard_normal((2, joints)).clip(-2, 2)
    true = Arm(given.mass * off[0], length, given.rotor * off[1])
    servo = Servo(gain=float(rng.uniform(12.0, 40.0)))
    truth: dict[str, float] = {}
    # The measured voltage already contains the delay of the reference, so the delay causes no gap.
    late = {"null": (0.0, 0.0), "late": (0.02, 0.06)}.get(what, (0.015, 0.04))
    servo = replace(servo, delay=float(rng.uniform(*((0.01, 0.04) if route == "measured" else late))))
    if route != "measured" and what != "null":
        truth["reference_delay"] = servo.delay
    if loaded:
        load = float(rng.uniform(0.15, 0.5))
        true = Arm(true.mass, length, true.rotor, load)
        truth["payload"] = load
    if what == "friction":
        servo = replace(servo, coulomb=float(rng.uniform(0.08, 0.25)), viscous=float(rng.uniform(0.1, 0.3)))
        truth |= {"coulomb_friction": servo.coulomb, "viscous_friction": servo.viscous}
    if what == "sag":
        servo = replace(servo, sag=float(rng.uniform(0.3, 0.8)))
    if what == "warm":
        servo = replace(servo, warms=float(rng.uniform(1.5, 3.0)))
    q_ref = reference(rng, t, joints)
    if what == "protection":
        # Beyond errors that the same servo without protection reaches for some of the time.
        _, u, _, _ = simulated(true, servo, t, q_ref)
        largest = np.abs(u / servo.gain).max(axis=1)
        beyond = float(np.quantile(largest, rng.uniform(0.9, 0.98)))
        servo = replace(servo, drops_beyond=beyond, drops_to=float(rng.uniform(0.04, 0.12)))
    read, u, share, supply = simulated(true, servo, t, q_ref)
    names = [f"j{j}" for j in range(joints)]
    columns = {"t": t} | {f"q.{name}": read[:, j] for j, name in enumerate(names)}
    columns |= {f"q_ref.{name}": q_ref[:, j] for j, name in enumerate(names)}
    if route == "command":
        asked = np.clip(servo.gain * (q_ref - read), -servo.supply, servo.supply)
        columns |= {f"u.{name}": asked[:, j] for j, name in enumerate(names)}
    elif what == "sag":
        columns |= {f"duty.{name}": share[:, j] for j, name in enumerate(names)} | {"supply": supply}
    elif route == "measured":
        if what == "warm":
            columns |= {f"temp.{name}": np.round(25.0 + servo.warms * t) for name in names}
        columns |= {f"u.{name}": u[:, j] for j, name in enumerate(names)}
    return Case(kind, truth, urdf(given), _config(given, servo, names, route), table(columns))


def _config(arm: Arm, servo: Servo, names: list[str], route: str) -> str:
    lines = ["reference_hold: zoh", "joints:"]
    for j, name in enumerate(names):
        own = (
            f"torque_constant: {servo.kt}, resistance: {servo.resistance}, rotor_inertia: {arm.rotor[j]:.6g}, "
            f"encoder_counts: {COUNTS}, encoder_side: link, voltage_limit: {servo.supply}"
        )
        if route == "motion":
            kp, kd = servo.gain * servo.kt / servo.resistance, servo.kt**2 / servo.resistance
            own += f", controller: {{kind: pd, kp: {kp:.6g}, kd: {kd:.6g}}}"
        lines.append(f"  {name}: {{{own}}}")
    return "\n".join(lines) + "\n"
