import pytest

import phantom_dyn as dyn
from places import ROBOTS

PENDULUM = str(ROBOTS / "pendulum.urdf")


@pytest.fixture(scope="session")
def reference():
    """A motion of the pendulum that shows its parameters."""
    return dyn.excite(PENDULUM, duration=15)


@pytest.fixture(scope="session")
def rubbing(reference):
    """A simulated recording of the pendulum with 1.5 N m of Coulomb friction more than its model has."""
    made = dyn.simulate(PENDULUM, reference, effects=[("coulomb_friction", "pin", {"torque": 1.5})])
    return made.recording(position_noise=1e-5, torque_noise=0.05)


@pytest.fixture(scope="session")
def diagnosis(rubbing):
    """Its diagnosis."""
    return dyn.diagnose(PENDULUM, rubbing)
