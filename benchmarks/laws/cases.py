"""Draw robots, motions and recordings of the cases from a seed, with equations of motion in closed form.

The torque is computed along a prescribed motion, so every law acts on exactly the logged motion. Masses,
inertias, friction and rotors of the model are wrong within the stated tolerances. Seeds below 1000 are for development.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

from benchmarks.laws.equations import DYNAMIC, LAWS, Law, State

Array = np.ndarray

RATE, SECONDS, BAND_HZ = 250.0, 20.0, 10.0
TOLERANCE = {"inertia": 0.05, "friction": 0.05, "rotor": 0.10}
GRAVITY = 9.81


@dataclass(frozen=True)
class Robot:
    """A kind of robot.

    Attributes:
        joints: Names.
        linear: True if the joints are prismatic, along x and z; otherwise they are revolute, about y.
        torque: Torque of the links from parameters, positions, velocities and accelerations.
        draw: Function that draws the parameters of the links.
    """

    joints: tuple[str, ...]
    linear: bool
    torque: Callable[[dict[str, float], Array, Array, Array], Array]
    draw: Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Case:
    """A recording with its true law.

    Attributes:
        name: Kind of law, or ``null``.
        folder: Folder with robot.urdf, robot.yaml and log.csv.
        joint: Joint on which the law acts.
        gap: Root mean square that tolerances cannot explain, divided by that of the noise, both below the band's edge.
        law: True law with its amplitude, or None for a null.
    """

    name: str
    folder: Path
    joint: str
    gap: float
    law: Law | None


def _pendulum(p: dict[str, float], q: Array, v: Array, a: Array) -> Array:
    inertia = p["I1"] + p["m1"] * p["c1"] ** 2
    return inertia * a - p["m1"] * GRAVITY * p["c1"] * np.cos(q)


def _arm(p: dict[str, float], q: Array, v: Array, a: Array) -> Array:
    m1, m2, c1, c2, l1 = p["m1"], p["m2"], p["c1"], p["c2"], p["l1"]
    cross = m2 * l1 * c2 * np.cos(q[:, 1])
    m22 = m2 * c2**2 + p["I2"]
    m11 = m1 * c1**2 + p["I1"] + m2 * l1**2 + m22 + 2 * cross
    m12 = m22 + cross
    h = m2 * l1 * c2 * np.sin(q[:, 1])
    g2 = -m2 * GRAVITY * c2 * np.cos(q[:, 0] + q[:, 1])
    g1 = -(m1 * c1 + m2 * l1) * GRAVITY * np.cos(q[:, 0]) + g2
    return np.column_stack(
        [
            m11 * a[:, 0] + m12 * a[:, 1] - h * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2) + g1,
            m12 * a[:, 0] + m22 * a[:, 1] + h * v[:, 0] ** 2 + g2,
        ]
    )


def _slides(p: dict[str, float], q: Array, v: Array, a: Array) -> Array:
    return np.column_stack([(p["m1"] + p["m2"]) * a[:, 0], p["m2"] * (a[:, 1] + GRAVITY)])


def _links(rng: np.random.Generator, count: int) -> dict[str, float]:
    out: dict[str, float] = {}
    for k in range(1, count + 1):
        m, length = rng.uniform(1.0, 4.0), rng.uniform(0.25, 0.5)
        out |= {f"m{k}": m, f"l{k}": length, f"c{k}": 0.5 * length, f"I{k}": m * length**2 / 12}
    return out


ROBOTS: tuple[Robot, ...] = (
    Robot(("j1", "j2"), False, _arm, lambda rng: _links(rng, 2)),
    Robot(("swing",), False, _pendulum, lambda rng: _links(rng, 1)),
    Robot(("x", "z"), True, _slides, lambda rng: _links(rng, 2)),
)


def _motion(rng: np.random.Generator, count: int, linear: bool) -> tuple[Array, Array, Array, Array]:
    """Time, position, velocity and acceleration: sums of slow and fast sines, or moves from point to point."""
    t = np.arange(int(RATE * SECONDS)) / RATE
    reach = 0.25 if linear else 1.0
    q, v, a = (np.zeros((len(t), count)) for _ in range(3))
    for j in range(count):
        if rng.random() < 0.7:
            for f in (rng.uniform(0.08, 0.2), rng.uniform(0.2, 0.5), rng.uniform(0.5, 1.1)):
                size, w, p = reach * rng.uniform(0.3, 0.9) * (0.15 / f) ** 0.5, 2 * np.pi * f, rng.uniform(0, 6.28)
                q[:, j] += size * np.sin(w * t + p)
                v[:, j] += size * w * np.cos(w * t + p)
                a[:, j] -= size * w**2 * np.sin(w * t + p)
            continue
        at, begin = 0.0, 0.0
        while begin < t[-1]:
            to, lasts = reach * rng.uniform(-1, 1), rng.uniform(0.8, 2.5)
            now = (t >= begin) & (t < begin + lasts)
            u, d = (t[now] - begin) / lasts, to - at
            q[now, j] = at + d * (10 * u**3 - 15 * u**4 + 6 * u**5)
            v[now, j] = d / lasts * (30 * u**2 - 60 * u**3 + 30 * u**4)
            a[now, j] = d / lasts**2 * (60 * u - 180 * u**2 + 120 * u**3)
            at, begin = to, begin + lasts
    return t, q, v, a


def _drive(robot: Robot, p: dict[str, float], q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Torque of the drive, and torque of the links alone."""
    link = np.asarray(robot.torque(p, q, v, a)).reshape(q.shape)
    nv = range(1, q.shape[1] + 1)
    own = [p[f"r{k}"] * a[:, k - 1] + p[f"d{k}"] * v[:, k - 1] + p[f"f{k}"] * np.sign(v[:, k - 1]) for k in nv]
    return link + np.column_stack(own), link


def _kind(name: str) -> str:
    return "rotor" if name[0] == "r" else "friction" if name[0] in "df" else "inertia"


def _beyond(
    robot: Robot, given: dict[str, float], motion: tuple[Array, ...], torque: Array, *, dynamic: bool = False
) -> Array:
    """Part of a torque that no change of the model within two tolerances can explain.

    For a dynamic law, the part that an offset, spring, damping, friction and inertia of a joint explain is subtracted
    too: these are effects of the catalogue, and the law is about what memory adds to them.
    """
    base = _drive(robot, given, *motion)[0]
    names = [name for name in given if name[0] != "l"]
    changes = []
    for name in names:
        size = TOLERANCE[_kind(name)]
        moved = _drive(robot, {**given, name: given[name] * (1 + size)}, *motion)[0] - base
        changes.append(_low(moved).ravel())
    bound = np.full(len(changes), 2.0)
    if dynamic:
        q, v, a = motion
        for x in (np.ones_like(q), q, v, a, np.sign(v)):
            changes += [_low(np.where(np.arange(q.shape[1]) == k, x, 0.0)).ravel() for k in range(q.shape[1])]
        bound = np.concatenate([bound, np.full(len(changes) - len(bound), np.inf)])
    found = lsq_linear(np.column_stack(changes), _low(torque).ravel(), (-bound, bound))
    return (_low(torque).ravel() - np.column_stack(changes) @ found.x).reshape(torque.shape)


def _low(x: Array) -> Array:
    return sosfiltfilt(butter(4, BAND_HZ, fs=RATE, output="sos"), x, axis=0)


def make(seed: int, folder: Path, *, null: bool = False, dynamic: bool = False) -> Case:
    """Write the files of a case.

    Args:
        seed: Selects the law in turn; everything else is random.
        folder: Folder for the files.
        null: True for a recording without a law.
        dynamic: True for a law whose answer changes with the frequency.
    """
    rng = np.random.default_rng([seed, 7 if null else 9 if dynamic else 5])
    laws = DYNAMIC if dynamic else LAWS
    robot = ROBOTS[int(rng.integers(len(ROBOTS)))]
    nv = len(robot.joints)
    given = robot.draw(rng)
    t, q, v, a = _motion(rng, nv, robot.linear)
    scale = np.sqrt(np.mean(np.asarray(robot.torque(given, q, v, a)).reshape(q.shape) ** 2, axis=0))
    for k in range(1, nv + 1):
        given |= {
            f"r{k}": rng.uniform(0.05, 0.3) * scale[k - 1] / np.sqrt(np.mean(a[:, k - 1] ** 2)) * 0.2,
            f"d{k}": rng.uniform(0.02, 0.08) * scale[k - 1] / np.sqrt(np.mean(v[:, k - 1] ** 2)),
            f"f{k}": rng.uniform(0.03, 0.12) * scale[k - 1],
        }
    given = {quantity: float(value) for quantity, value in given.items()}
    true = {n: x * (1 + TOLERANCE[_kind(n)] * float(np.clip(rng.normal(), -1.6, 1.6))) for n, x in given.items()}
    true |= {name: x for name, x in given.items() if name[0] == "l"}
    need, link = _drive(robot, true, q, v, a)
    noise = scale * rng.uniform(0.01, 0.02) * (rng.normal(size=q.shape) + 2.0 * _low(rng.normal(size=q.shape)))
    floor = np.sqrt(np.mean(_low(noise) ** 2, axis=0))
    name = "null" if null else tuple(laws)[seed % len(laws)]
    j, law, gap, torque = int(rng.integers(nv)), None, 0.0, np.zeros_like(q)
    if not null:
        law = laws[name](State(t, q, v, need, link, j, robot.joints), rng)
        unit = np.zeros_like(q)
        unit[:, j] = law.parts.sum(axis=1)
        gap = float(np.exp(rng.uniform(np.log(2.5), np.log(25.0))))
        size = gap * floor[j] / np.sqrt(np.mean(_beyond(robot, given, (q, v, a), unit, dynamic=dynamic)[:, j] ** 2))
        law = Law(size * law.parts, law.required, law.allowed, law.temperature)
        torque[:, j] = law.parts.sum(axis=1)
        gap = float(np.sqrt(np.mean(_beyond(robot, given, (q, v, a), torque, dynamic=dynamic)[:, j] ** 2)) / floor[j])
    step = 2 * np.pi / 2**17 * (0.3 if robot.linear else 1.0)
    reading = np.round(q / step) * step
    columns = {"t": t}
    for k, joint in enumerate(robot.joints):
        columns |= {f"q.{joint}": reading[:, k], f"tau.{joint}": (need + torque + noise)[:, k]}
    if law is not None and law.temperature is not None:
        columns[f"temp.{robot.joints[j]}"] = np.round(law.temperature, 1)
    _write(folder, robot, given, columns)
    return Case(name, folder, robot.joints[j], gap, law)


def _write(folder: Path, robot: Robot, given: dict[str, float], columns: dict[str, Array]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "log.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
    (folder / "robot.urdf").write_text(_urdf(robot, given), encoding="utf-8")
    rotors = "".join(
        f"  {joint}: {{rotor_inertia: {given[f'r{k}']!r}}}\n" for k, joint in enumerate(robot.joints, start=1)
    )
    (folder / "robot.yaml").write_text(f"torque_source: sensor\njoints:\n{rotors}", encoding="utf-8")


def _urdf(robot: Robot, p: dict[str, float]) -> str:
    out = ['<robot name="bench"><link name="base"/>']
    for k, joint in enumerate(robot.joints, start=1):
        place = f"{p[f'l{k - 1}']!r} 0 0" if k > 1 and not robot.linear else "0 0 0"
        axis = "0 1 0" if not robot.linear else ("1 0 0" if k == 1 else "0 0 1")
        inertia = p[f"I{k}"]
        out.append(
            f'<joint name="{joint}" type="{"prismatic" if robot.linear else "revolute"}">'
            f'<parent link="{"base" if k == 1 else f"link{k - 1}"}"/><child link="link{k}"/>'
            f'<origin xyz="{place}" rpy="0 0 0"/><axis xyz="{axis}"/>'
            f'<limit lower="-10" upper="10" effort="10000" velocity="100"/>'
            f'<dynamics damping="{p[f"d{k}"]!r}" friction="{p[f"f{k}"]!r}"/></joint>'
            f'<link name="link{k}"><inertial><origin xyz="{p[f"c{k}"]!r} 0 0" rpy="0 0 0"/>'
            f'<mass value="{p[f"m{k}"]!r}"/>'
            f'<inertia ixx="{0.5 * inertia!r}" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )
    return "".join(out) + "</robot>\n"
