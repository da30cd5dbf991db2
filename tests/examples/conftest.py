"""A recording that examples and pages diagnose, and environments with and without other recordings."""

from pathlib import Path

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion
from places import ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"

# A proxy where nobody listens: every address is out of reach, at once and on every machine.
NO_NETWORK = {name: "http://127.0.0.1:9" for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY")}


@pytest.fixture
def rubbing_pendulum(tmp_path: Path, rng: np.random.Generator) -> Path:
    """Folder with ``robot.urdf`` and a ``log.csv`` of a pendulum that has 1.5 N m of Coulomb friction more than it."""
    robot = load_robot(PENDULUM)
    t = np.arange(0, 20, 0.002)
    w, size = 2 * np.pi * np.array([0.13, 0.41, 0.97]), np.array([0.6, 0.4, 0.15])
    phase = np.outer(t, w)
    q, v, a = ((f * size).sum(axis=1)[:, None] for f in (np.sin(phase), np.cos(phase) * w, -np.sin(phase) * w**2))
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + 1.5 * np.sign(v) + 0.05 * rng.normal(size=q.shape)
    columns = np.column_stack([t, q, tau])
    (tmp_path / "robot.urdf").write_text(PENDULUM.read_text())
    np.savetxt(tmp_path / "log.csv", columns, fmt="%.9g", delimiter=",", header="t,q.pin,tau.pin", comments="")
    return tmp_path


@pytest.fixture
def offline(tmp_path: Path) -> dict[str, str]:
    """Environment without a network, without recordings and with an empty cache."""
    return {**NO_NETWORK, "PHANTOM_DYN_DATA": "", "XDG_CACHE_HOME": str(tmp_path / "cache")}


@pytest.fixture(scope="session")
def mirror(data_folder: Path) -> dict[str, str]:
    """Environment in which the recordings are at hand."""
    return {"PHANTOM_DYN_DATA": str(data_folder)}
