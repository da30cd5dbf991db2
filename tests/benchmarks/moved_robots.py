"""Robots of the generator, moved without noise, and what Pinocchio says of their motion."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace

import numpy as np
import pinocchio as pin

from benchmarks.gapbench.generator.files import urdf_text
from benchmarks.gapbench.generator.reference import draw_reference
from benchmarks.gapbench.generator.robots import Tolerance
from benchmarks.gapbench.generator.setup import draw_setup, quiet, run_of
from benchmarks.gapbench.generator.sizing import at_samples

TRUSTED = Tolerance(0.0, 0.0, 0.0)


def pinocchio_model(table):
    model = pin.buildModelFromXML(urdf_text(table))
    model.armature = np.array([link.rotor_inertia for link in table.links])
    model.gravity.linear = np.array(table.gravity)
    return model


def pinocchio_torque(table, q, v, a):
    """Torque of the active joints: that of the tree, projected where the robot is a closed chain."""
    model, select = pinocchio_model(table), table.selection()
    data = model.createData()
    rows = zip(q @ select.T, v @ select.T, a @ select.T, strict=True)
    return np.array([pin.rnea(model, data, *row) for row in rows]) @ select


def friction_torque(table, v):
    """Torque that modelled friction asks of the drive: c v + T sign(v)."""
    viscous, coulomb = (np.array([getattr(link, name) for link in table.driven]) for name in ("viscous", "coulomb"))
    return viscous * v + coulomb * np.sign(v)


def short_setup(seed, robot, seconds=8.0):
    """A trusted robot without noise on a Fourier motion, which hardly ever stands still."""
    setup = quiet(draw_setup(seed, robot=robot, tolerance=TRUSTED))
    session = setup.session
    t = np.arange(round(seconds * session.rate)) / session.rate
    reference = draw_reference(np.random.default_rng(seed), setup.owner, "fourier", t)
    none = np.zeros_like(reference)
    return replace(setup, session=replace(session, reference=reference, disturbance=none, dither=none))


def moving(v):
    """Samples with no reversal near: at one, the sign of v changes within a sample."""
    return (np.abs(v) > 0.05).all(axis=1)


def motion_of(run, rate):
    """q, v, a of what the encoders read, by central differences."""
    q, a = run.seen, np.zeros_like(run.seen)
    a[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) * rate**2
    return q, np.gradient(q, 1.0 / rate, axis=0), a


def kept(v):
    """Moving samples without the two at either end, where differences have no neighbour."""
    keep = moving(v)
    keep[[0, 1, -2, -1]] = False
    return keep


def missing_torque(setup, *effects, outside=None):
    """Torque that the moving robot gets besides the logged one, from the truth of the run: needed less logged."""
    run = run_of(setup, *effects, outside=outside)
    q, v, a = motion_of(run, setup.session.rate)
    needed = pinocchio_torque(setup.truth, q, v, a) + friction_torque(setup.truth, v)
    return needed - at_samples(run.command), run, (q, v, a)
