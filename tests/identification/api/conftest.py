import numpy as np
import pytest

import phantom_dyn as dyn
from places import ROBOTS
from sines import sines

PENDULUM = str(ROBOTS / "pendulum.urdf")


@pytest.fixture(scope="session")
def reference():
    """A motion of the pendulum that shows its parameters."""
    return dyn.excite(PENDULUM, duration=15)


@pytest.fixture(scope="session")
def rubbing():
    """A simulated recording of the pendulum with 1.5 N m of Coulomb friction more than its model has.

    Its motion is not designed: which of several good motions a design ends in depends on how a processor rounds.
    """
    motion = sines(np.arange(1501) / 100, 1, np.random.default_rng(1), size=0.3)
    made = dyn.simulate(PENDULUM, motion, effects=[("coulomb_friction", "pin", {"torque": 1.5})])
    return made.recording(position_noise=1e-5, torque_noise=0.05)


@pytest.fixture(scope="session")
def diagnosis(rubbing):
    """Its diagnosis."""
    return dyn.diagnose(PENDULUM, rubbing)
