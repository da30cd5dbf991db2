"""Fixtures that every test may use."""

import os

# One thread each, before numpy loads its linear algebra: the workers of pytest share the machine.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import gc
import zlib
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

from jaxtyping import install_import_hook

# What `make shapes` sets: annotations of shapes are checked, which takes a third more of the time of all tests.
SHAPES = "PHANTOM_DYN_SHAPES" in os.environ
# Shape annotations of these packages are checked there, save those of compiled functions. Where checks would cost many
# times what they check (a step of phantom_dyn.simulation, a fit of the diagnosis), modules are named one by one.
CHECKED = [
    "identification.data",
    "identification.degrade",
    "identification.diagnosis.fit.full_fit",
    "identification.diagnosis.fit.whole_model",
    "identification.diagnosis.columns.operations",
    "identification.diagnosis.result",
    "identification.estimators",
    "identification.excitation",
    "identification.experiments",
    "identification.export",
    "identification.identify",
    "identification.next_experiment",
    "identification.regression",
    "identification.reporting.page.explaining",
    "identification.reporting.page.gap_figures",
    "identification.reporting.page.robot_scene",
    "identification.reporting.charts.thinning",
    "identification.rollout",
    "identification.scenarios",
    "phantom_dyn.devices",
    "phantom_dyn.dynamics",
    "phantom_dyn.effects",
    "phantom_dyn.haptics",
    "phantom_dyn.loops",
    "phantom_dyn.maps",
    "phantom_dyn.model.inertia",
    "phantom_dyn.model.robot",
    "phantom_dyn.motion",
    "phantom_dyn.shapes",
    "phantom_dyn.walking",
]
# Not with pytest's flag --jaxtyping-packages, which cannot pass an option to the checker: an int is a fine float
# (PEP 484).
if SHAPES:
    install_import_hook(CHECKED, "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))")

import numpy as np
import pytest

from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot

TESTS = Path(__file__).resolve().parent
CHECKOUT = TESTS.parent
ROBOTS = TESTS / "robots"
# Folders whose tests `make shapes` runs, as they call one function after the other. So do those in no folder.
CHECKING = {
    TESTS / folder
    for folder in (
        "identification/data",
        "identification/degrade",
        "identification/diagnosis/columns",
        "identification/diagnosis/fit",
        "identification/estimators",
        "identification/excitation",
        "identification/experiments",
        "identification/export",
        "identification/identify",
        "identification/next_experiment",
        "identification/regression",
        "identification/reporting",
        "identification/rollout",
        "identification/scenarios",
        "phantom_dyn",
    )
}


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Search for no garbage while modules are read, and leave them and the tests out of every later search.

    They are half a million objects that stay to the end.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is of the other kind of run: `make shapes` runs what checks, all others what needs no check."""
    left = {item for item in items if (not checks_shapes(item) if SHAPES else item.get_closest_marker("shapes"))}
    config.hook.pytest_deselected(items=list(left))
    items[:] = [item for item in items if item not in left]


def checks_shapes(item: pytest.Item) -> bool:
    """Whether a test is one of `make shapes`: those in the folders ``CHECKING``.

    Left out are tests marked ``whole``, which run as a whole, or many times, what others check, and all but the first
    case of a parametrised test, since the others call the same functions.
    """
    case = getattr(item, "callspec", None)
    later = case is not None and any(case.indices.values())
    here = item.path.parent == TESTS or not CHECKING.isdisjoint(item.path.parents)
    return here and not later and item.get_closest_marker("whole") is None


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of the real recordings, one folder each; without it a test is skipped, under CI it fails."""
    given = os.environ.get("PHANTOM_DYN_DATA")
    folder = Path(given) if given else CHECKOUT.parent / "shared" / "data"
    if folder.is_dir():
        return folder.resolve()
    reason = f"the real recordings are not at {folder}: set PHANTOM_DYN_DATA to the folder that holds them"
    if os.environ.get("CI") == "true":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def pendulum() -> Robot:
    """A rod of 2 kg with its centre 0.5 m below joint pin, 0.6 kg m^2 about it; friction 0.3 N m s/rad and 0.7 N m."""
    return load_robot(ROBOTS / "pendulum.urdf")


@pytest.fixture(scope="session")
def arm() -> Robot:
    """Joints turn and tilt (hinges) and slide (linear), with modelled friction."""
    return load_robot(ROBOTS / "arm3.urdf")


@pytest.fixture(scope="session")
def planar() -> Robot:
    """Joints shoulder and elbow, both about y, hanging, with friction and rotors; torque follows the controller."""
    robot = load_robot(ROBOTS / "planar2.urdf")
    model = robot.model.copy()
    model.armature = np.array([0.3, 0.1])
    return replace(robot, model=model)


@pytest.fixture(scope="session")
def robots() -> Path:
    """Folder of the small robots of the tests."""
    return ROBOTS


@pytest.fixture(autouse=True)
def no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """No line of progress, however slow the machine is: what a command prints must not depend on that."""
    monkeypatch.setattr("identification.cli.terminal.progress.EVERY_S", 1e6)


@pytest.fixture(scope="session", autouse=True)
def no_plan() -> Generator[Callable, None, None]:
    """No next experiment is planned where none is looked at: no finding depends on it, and it takes as long as they do.

    Returns the function that plans; a test that looks at its plan asks for the fixture `plan`.
    """
    from identification import pipeline
    from identification.next_experiment.advise import Proposal

    planned = pipeline.planned
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "planned", lambda *_: Proposal())
        yield planned


@pytest.fixture
def plan(no_plan: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next experiment is planned, as for users."""
    monkeypatch.setattr("identification.pipeline.planned", no_plan)


@pytest.fixture(scope="session", autouse=True)
def no_mujoco_log() -> Generator[None, None, None]:
    """No MUJOCO_LOG.TXT in the working folder, which MuJoCo writes its warnings into where nobody takes them."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    yield
    mujoco.set_mju_user_warning(before)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Random numbers that depend on nothing but the name of the test, wherever its file lies."""
    return np.random.default_rng(zlib.crc32(request.node.name.encode()))
