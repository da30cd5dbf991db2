"""Fixtures that every test may use."""

from __future__ import annotations

import os

# One thread each, before numpy loads its linear algebra: the workers of pytest share the machine.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import zlib
from pathlib import Path

from jaxtyping import install_import_hook

# Shape annotations of these modules are checked at every call. By name: never a whole package, for what numba
# compiles cannot be wrapped; nor phantom_dyn.simulation.simulate and stepping, as checks cost ten times a step. Not
# with
# pytest's flag --jaxtyping-packages, which cannot pass an option to the checker: an int is a fine float (PEP 484).
install_import_hook(
    [
        "identification.at_rest",
        "identification.corrected",
        "identification.degrade.degradation",
        "identification.degrade.degraded_log",
        "identification.reporting.explaining",
        "identification.reporting.gap_figures",
        "identification.reporting.robot_scene",
        "identification.diagnosis.fit.joint_fit",
        "identification.reporting.explaining",
        "phantom_dyn.shapes.mesh_reduction",
        "identification.diagnosis.model.operations",
        "identification.diagnosis.fit.other_laws",
        "identification.diagnosis.fit.whole_model",
        "identification.diagnosis.result",
        "identification.reporting.robot_scene",
        "phantom_dyn.shapes.robot_shapes",
        "identification.diagnosis.fit.whole_model",
        "phantom_dyn.shapes.solids",
        "identification.reporting.thinning",
        "identification.estimators",
        "identification.excitation",
        "identification.experiments",
        "identification.export",
        "identification.identify",
        "identification.known_changes",
        "identification.data.log",
        "identification.motion_only",
        "identification.next_experiment",
        "identification.data.readers.read_table",
        "identification.data.recording",
        "identification.regression.regressor",
        "identification.degrade.degraded_log",
        "identification.rollout",
        "identification.data.signals",
        "identification.uses",
        "phantom_dyn.dynamics.tree_motion",
        "phantom_dyn.motion",
        "phantom_dyn.simulation.control",
        "phantom_dyn.devices.biped",
        "phantom_dyn.devices.cea",
        "phantom_dyn.devices.cea_dynamics",
        "phantom_dyn.devices.cea",
        "phantom_dyn.devices.cea_dynamics",
        "phantom_dyn.devices.phantom",
        "phantom_dyn.devices.phantom_dynamics",
        "phantom_dyn.dynamics.dynamics",
        "phantom_dyn.effects",
        "phantom_dyn.haptics.arguments",
        "phantom_dyn.haptics.device.axis",
        "phantom_dyn.haptics.cheap.cheap_axis",
        "phantom_dyn.haptics.cheap.cheap_hardware",
        "phantom_dyn.haptics.device.discretisation",
        "phantom_dyn.haptics.device.drives",
        "phantom_dyn.haptics.sensing.encoder",
        "phantom_dyn.haptics.stability.force_feedforward",
        "phantom_dyn.haptics.figures",
        "phantom_dyn.haptics.experiments.frequency_identification",
        "phantom_dyn.haptics.experiments.white_noise",
        "phantom_dyn.haptics.sensing.loop_simulation",
        "phantom_dyn.haptics.device.axis",
        "phantom_dyn.haptics.stability.passivity",
        "phantom_dyn.haptics.stability.phantom_improvements",
        "phantom_dyn.haptics.device.published",
        "phantom_dyn.haptics.experiments.relay",
        "phantom_dyn.haptics.stability.sampled_loop",
        "phantom_dyn.haptics.stability.critical_stiffness",
        "phantom_dyn.haptics.stability.critical_stiffness",
        "phantom_dyn.haptics.stability.passivity",
        "phantom_dyn.haptics.device.transfer_function",
        "phantom_dyn.haptics.sensing.velocity_comparison",
        "phantom_dyn.haptics.sensing.velocity_estimators",
        "phantom_dyn.haptics.stability.virtual_wall",
        "phantom_dyn.haptics.experiments.white_noise",
        "phantom_dyn.model.inertia",
        "phantom_dyn.dynamics.kinematics",
        "phantom_dyn.loops",
        "phantom_dyn.maps.quantities",
        "phantom_dyn.maps.from_robot",
        "phantom_dyn.motion",
        "phantom_dyn.model.robot",
        "phantom_dyn.walking",
    ],
    "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))",
)

import numpy as np
import pytest

CHECKOUT = Path(__file__).resolve().parents[1]


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


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Random numbers that depend on nothing but the name of the test."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))
