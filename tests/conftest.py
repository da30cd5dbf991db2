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
# compiles cannot be wrapped; nor phantom_dyn.simulation and stepping, as checks cost ten times a step. Not with
# pytest's flag --jaxtyping-packages, which cannot pass an option to the checker: an int is a fine float (PEP 484).
install_import_hook(
    [
        "identification.at_rest",
        "identification.corrected",
        "identification.degradation",
        "identification.degrade",
        "identification.diagnosis.explaining",
        "identification.diagnosis.figures",
        "identification.diagnosis.gap_shares",
        "identification.diagnosis.joint_fit",
        "identification.diagnosis.joint_motion",
        "identification.diagnosis.mesh_reduction",
        "identification.diagnosis.moved_model",
        "identification.diagnosis.other_laws",
        "identification.diagnosis.point",
        "identification.diagnosis.result",
        "identification.diagnosis.robot_scene",
        "identification.diagnosis.robot_shapes",
        "identification.diagnosis.setting",
        "identification.diagnosis.solids",
        "identification.diagnosis.thinning",
        "identification.estimators",
        "identification.excitation",
        "identification.experiments",
        "identification.export",
        "identification.identify",
        "identification.known_changes",
        "identification.log",
        "identification.motion_only",
        "identification.next_experiment",
        "identification.readers",
        "identification.recordings",
        "identification.regressor",
        "identification.replay",
        "identification.rollout",
        "identification.signals",
        "identification.uses",
        "phantom_dyn.closed_chain",
        "phantom_dyn.configuration",
        "phantom_dyn.control",
        "phantom_dyn.devices.biped",
        "phantom_dyn.devices.cea",
        "phantom_dyn.devices.cea_dynamics",
        "phantom_dyn.devices.cea_loop",
        "phantom_dyn.devices.cea_operational",
        "phantom_dyn.devices.phantom",
        "phantom_dyn.devices.phantom_dynamics",
        "phantom_dyn.dynamics",
        "phantom_dyn.effects",
        "phantom_dyn.haptics.arguments",
        "phantom_dyn.haptics.axis",
        "phantom_dyn.haptics.cheap_axis",
        "phantom_dyn.haptics.cheap_hardware",
        "phantom_dyn.haptics.discretisation",
        "phantom_dyn.haptics.drives",
        "phantom_dyn.haptics.encoder",
        "phantom_dyn.haptics.feedforward",
        "phantom_dyn.haptics.figures",
        "phantom_dyn.haptics.frequency_identification",
        "phantom_dyn.haptics.frequency_response",
        "phantom_dyn.haptics.loop_simulation",
        "phantom_dyn.haptics.operator",
        "phantom_dyn.haptics.passivity",
        "phantom_dyn.haptics.phantom_improvements",
        "phantom_dyn.haptics.published",
        "phantom_dyn.haptics.relay",
        "phantom_dyn.haptics.sampled_loop",
        "phantom_dyn.haptics.stability",
        "phantom_dyn.haptics.stability_map",
        "phantom_dyn.haptics.teleoperation",
        "phantom_dyn.haptics.transfer_function",
        "phantom_dyn.haptics.velocity_comparison",
        "phantom_dyn.haptics.velocity_estimators",
        "phantom_dyn.haptics.virtual_wall",
        "phantom_dyn.haptics.white_noise",
        "phantom_dyn.inertia",
        "phantom_dyn.kinematics",
        "phantom_dyn.loops",
        "phantom_dyn.maps.disturbance",
        "phantom_dyn.maps.from_robot",
        "phantom_dyn.motion",
        "phantom_dyn.robot",
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
