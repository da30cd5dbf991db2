"""A rod that swings as a sine, as a recorded part of a sealed case, and what a law adds to it."""

import numpy as np

from benchmarks.blind.makes.real.body import body
from benchmarks.blind.makes.real.motion import even
from benchmarks.blind.makes.real.recordings import Run
from benchmarks.blind.makes.real.scene import scene_of

ROD = """<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>
"""
MASS, FAR, INERTIA, G = 2.0, 0.5, 0.1, 9.81
SWING, PACE, RATE, SECONDS = 0.6, 2.0 * np.pi * 0.5, 200.0, 8.0


def rod_scene(yaml=""):
    """A rod of 2 kg that swings as a sine, with the torque that this needs."""
    robot = body(ROD, yaml, ("pin",))
    t = np.arange(round(RATE * SECONDS)) / RATE
    q = SWING * np.sin(PACE * t)
    tau = (INERTIA + MASS * FAR**2) * -(PACE**2) * q + MASS * G * FAR * np.sin(q)
    run = Run(t, q[:, None], tau[:, None])
    return scene_of(robot, ("pin",), (run,), (even(run, 40.0),), 10.0)


def added(law, size, scene=None, seed=3):
    """What a law adds to torque and position of the rod, its parameters, and where the filters are at rest."""
    scene = scene or rod_scene()
    effect = law(scene, 0, np.random.default_rng(seed))
    (run,) = effect.put(size)
    inside = slice(100, -100)
    old = scene.runs[0]
    return (run.tau - old.tau)[inside, 0], (run.q - old.q)[inside, 0], effect.parameters(size), inside


def motion(inside):
    t = (np.arange(round(RATE * SECONDS)) / RATE)[inside]
    return SWING * np.sin(PACE * t), SWING * PACE * np.cos(PACE * t), -SWING * PACE**2 * np.sin(PACE * t)


def away_from_reversals(v):
    return np.abs(v) > 0.05 * np.abs(v).max()
