"""The baselines, and the fit that knows the true cause: on columns written by hand, and on a pendulum of MuJoCo."""

import json
import subprocess
import sys
from collections import namedtuple
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from benchmarks.blind.baselines.always_coulomb import always_coulomb
from benchmarks.blind.baselines.answers import timed
from benchmarks.blind.baselines.independent_bic import bic, independent_bic, select
from benchmarks.blind.baselines.least_squares import Choice, Row, Task, fit, residual_rms
from benchmarks.blind.oracle import true_set
from benchmarks.blind.processes import ORACLE, run_case
from benchmarks.gapbench.baselines import mujoco_sysid as sysid_baseline
from benchmarks.gapbench.baselines.mujoco_sysid import DELAY, mujoco_sysid, torque_of
from benchmarks.gapbench.baselines.windows import Windows, read_windows, robot_spec
from places import CHECKOUT

SAMPLES = 400
DRY, SECONDS, DT = 0.3, 8.0, 0.002

URDF = """
<robot name="arm">
  <link name="base"/>
  <link name="rod">
    <inertial><origin xyz="0 0 -0.3"/><mass value="1.0"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="j1" type="revolute">
    <parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="30"/><dynamics damping="0.05" friction="0.02"/>
  </joint>
</robot>
"""
YAML = """
torque_hold: zoh
tolerance: {inertia: 0.05, friction: 0.05, rotor_inertia: 0.10}
joints:
  j1: {rotor_inertia: 0.01}
"""


def task_of(columns: list[np.ndarray], rests: list[np.ndarray], choices: list[Choice]) -> Task:
    """A task whose rows all see the same columns, without nuisances."""
    w = np.stack(columns, axis=1)
    index = np.arange(w.shape[1])
    rows = tuple(Row(index, w.T @ w, w.T @ r, float(r @ r), len(r)) for r in rests)
    robot = SimpleNamespace(joint_names=tuple(f"j{k + 1}" for k in range(len(rests))))
    return Task(robot, rows, tuple(choices), 0, np.zeros(len(index)))  # pyright: ignore[reportArgumentType]


@pytest.fixture
def columns(rng):
    return list(rng.normal(size=(3, SAMPLES)))


CHOICES = [Choice("viscous_friction", "j1", (0,), 1), Choice("torque_offset", "j1", (1,), 1)]


def test_bic_has_its_closed_form(columns, rng):
    rest = 2.0 * columns[0] + 0.1 * rng.normal(size=SAMPLES)
    task = task_of(columns, [rest], CHOICES)
    squared = np.linalg.lstsq(columns[0][:, None], rest, rcond=None)[1][0]
    expected = SAMPLES * np.log(squared / SAMPLES) + np.log(SAMPLES)
    assert bic(task, (CHOICES[0],), np.ones(1)) == pytest.approx(expected)


def test_a_fit_equals_numpy_least_squares(columns, rng):
    rest = rng.normal(size=SAMPLES)
    task = task_of(columns, [rest], CHOICES)
    expected = np.linalg.lstsq(np.stack(columns[:2], axis=1), rest, rcond=None)[0]
    np.testing.assert_allclose(fit(task, (0, 1), np.ones(1))[:2], expected)


def test_a_tolerance_holds_a_nuisance_back(columns):
    """Closed form: one column w, residual w, prior precision w.w halves the estimate."""
    task = task_of(columns[:1], [columns[0]], [])
    task = Task(task.robot, task.rows, (), 1, np.array([columns[0] @ columns[0]]))
    assert fit(task, (), np.ones(1))[0] == pytest.approx(0.5)


def test_selection_takes_the_true_effect_and_leaves_the_other(columns, rng):
    rest = 2.0 * columns[0] + 0.1 * rng.normal(size=SAMPLES)
    chosen, sigma = select(task_of(columns, [rest], CHOICES))
    assert chosen == (CHOICES[0],)
    assert sigma[0] == pytest.approx(0.1, rel=0.1)


def test_pure_noise_is_no_gap(columns, rng):
    assert independent_bic(task_of(columns, [rng.normal(size=SAMPLES)], CHOICES))["verdict"] == "no_gap"


def test_exact_twins_share_the_probability(columns, rng):
    rest = 2.0 * columns[0] + 0.1 * rng.normal(size=SAMPLES)
    twins = [Choice("rotor_inertia", "j1", (0,), 1), Choice("inertial_parameters", "j1", (1,), 1)]
    said = independent_bic(task_of([columns[0], columns[0], columns[2]], [rest], twins))["findings"][0]
    assert said["probability"] == pytest.approx(0.5)
    assert said["rivals"][0]["probability"] == pytest.approx(0.5)


def test_always_coulomb_names_the_joint_where_it_takes_most_off(columns, rng):
    rests = [rng.normal(size=SAMPLES), columns[1] + 0.1 * rng.normal(size=SAMPLES)]
    choices = [Choice("coulomb_friction", "j1", (0,), 1), Choice("coulomb_friction", "j2", (1,), 1)]
    said = always_coulomb(task_of(columns, rests, choices))
    assert [(f["effect"], f["joint"]) for f in said["findings"]] == [("coulomb_friction", "j2")]


def test_residuals_without_a_fit_are_those_given(columns, rng):
    rest = rng.normal(size=SAMPLES)
    assert residual_rms(task_of(columns, [rest], []), np.zeros(3))[0] == pytest.approx(np.sqrt(np.mean(rest**2)))


def test_a_baseline_that_breaks_is_no_answer_and_its_sentence_is_kept():
    def broken() -> dict:
        raise ValueError("no such joint")

    said = timed(broken)
    assert (said["verdict"], said["said"]) == ("failed", "ValueError: no such joint")


def pendulum_log(frictionloss: float, armature: float) -> np.ndarray:
    """t, q, tau of the pendulum that MuJoCo moves under a PD controller, with a little noise in torque."""
    rng = np.random.default_rng(5)
    spec = mujoco.MjSpec.from_string(URDF)
    spec.option.timestep = DT
    spec.joint("j1").armature = armature
    spec.joint("j1").frictionloss = frictionloss
    motor = spec.add_actuator(name="m", target="j1", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.gainprm[0] = 1.0
    model = spec.compile()
    data, rows = mujoco.MjData(model), []
    for k in range(round(SECONDS / DT)):
        t = k * DT
        wanted = 0.8 * np.sin(1.3 * t) + 0.4 * np.sin(4.1 * t + 1.0)
        tau = 40.0 * (wanted - data.qpos[0]) - 2.0 * data.qvel[0]
        rows.append((t, data.qpos[0], tau))
        data.ctrl[0] = tau + 0.01 * rng.normal()
        mujoco.mj_step(model, data)
    return np.array(rows)


@pytest.fixture(scope="module")
def sticky(tmp_path_factory):
    """A case whose joint has more dry friction than its model."""
    folder = tmp_path_factory.mktemp("cases") / "c1"
    folder.mkdir()
    (folder / "robot.urdf").write_text(URDF)
    (folder / "robot.yaml").write_text(YAML)
    log = pendulum_log(0.02 + DRY, 0.01)
    np.savetxt(folder / "log.csv", log, delimiter=",", header="t,q.j1,tau.j1", comments="")
    return folder


def test_the_toolbox_recovers_dry_friction_that_mujoco_simulated(sticky):
    """Known truth: one parameter changed, everything else as modelled."""
    said = mujoco_sysid(sticky / "robot.urdf", sticky / "log.csv")
    assert [(f["effect"], f["joint"]) for f in said["findings"]] == [("coulomb_friction", "j1")]


def test_a_toolbox_that_is_not_installed_is_left_out_with_a_sentence(sticky, monkeypatch):
    monkeypatch.setattr(sysid_baseline, "installed", lambda: False)
    said = mujoco_sysid(sticky / "robot.urdf", sticky / "log.csv")
    assert said["left_out"] == "the toolbox is not installed: pip install mujoco[sysid]"


def test_the_simulated_model_has_what_urdf_and_yaml_say(sticky):
    model = robot_spec(sticky / "robot.urdf", DT).compile()
    assert (model.dof_armature[0], model.dof_damping[0], model.dof_frictionloss[0]) == (0.01, 0.05, 0.02)


PARALLELOGRAM = """
<robot name="links">
  <link name="base"/>
  <link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
  <joint name="p" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 0 1"/></joint>
</robot>
"""


def test_a_linear_loop_holds_its_passive_joint(tmp_path):
    """Closed form: b does not turn, so the drive moves the inertia of a and the mass of b at 0.4 m: 0.21 kg m^2."""
    (tmp_path / "robot.urdf").write_text(PARALLELOGRAM)
    (tmp_path / "robot.yaml").write_text('loops: [{kind: linear, active: [j1], passive: {p: "-j1"}}]')
    model = robot_spec(tmp_path / "robot.urdf", 1e-3).compile()
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.21
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert data.qvel == pytest.approx([0.5, -0.5], rel=0.02)


def test_a_loop_of_points_is_refused(tmp_path):
    (tmp_path / "robot.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text("loops: [{kind: point, frame_a: a, frame_b: b}]")
    with pytest.raises(ValueError, match="a loop of kind point was given: this baseline knows linear ones"):
        robot_spec(tmp_path / "robot.urdf", DT)


def test_windows_hold_the_motion_of_the_log(sticky):
    windows = read_windows(sticky / "robot.urdf", sticky / "log.csv", ("j1",))
    assert windows.dt == pytest.approx(DT)
    assert windows.starts[-1] + windows.length < len(windows.q)
    # The speed summed up by trapezoids is the way.
    q, v = windows.q[1000:2000, 0], windows.v[1000:2000, 0]
    way = np.cumsum(0.5 * (v[1:] + v[:-1])) * windows.dt
    np.testing.assert_allclose(way, q[1:] - q[0], atol=1e-3)


def test_the_torque_of_a_parameter_has_its_closed_form():
    n = np.arange(4.0)[:, None]
    windows = Windows(("j1",), 0.1, n, n, 2.0 + 0.0 * n, 10.0 + 0.0 * n, np.array([0]), 2, {})
    assert torque_of("armature.j1", 3.0, windows) == pytest.approx(0.6)
    assert torque_of(DELAY, 0.01, windows) == pytest.approx(0.0)


def test_a_search_that_is_given_the_truth_takes_the_best_shape_and_nothing_else():
    term = namedtuple("term", ["effect_joint", "shape"])
    terms = (term(("cogging", "j1"), 6), term(("cogging", "j1"), 12), term(("payload", None), 0))
    search = SimpleNamespace(terms=terms, score=lambda chosen: sum(abs(t.shape - 12) for t in chosen))
    truth = frozenset({("cogging", "j1"), ("backlash", "j2")})
    assert true_set(truth)(search, lambda _: None, frozenset()) == {terms[1]}  # pyright: ignore[reportArgumentType]


def test_the_oracle_closes_the_gap_of_the_true_effect(sticky, tmp_path):
    """Known truth: dry friction of 0.3 N m that the model lacks."""
    answer = tmp_path / "a.json"
    answer.write_text(json.dumps({"effects": [{"effect": "coulomb_friction", "joint": "j1", "parameters": {}}]}))
    entry = json.loads(run_case(ORACLE, sticky, tmp_path, answer).read_text())
    assert entry["exit_code"] == 0, entry["said"]
    finding = entry["diagnosis"]["findings"][0]
    assert finding["effect"] == "coulomb_friction"
    assert finding["parameters"]["torque"]["value"] == pytest.approx(DRY, rel=0.05)


def test_all_baselines_answer_a_case_as_the_diagnosis_is_called(sticky, tmp_path):
    code = [sys.executable, str(CHECKOUT / "benchmarks/blind/baselines/answers.py")]
    out = tmp_path / "said.json"
    subprocess.run([*code, "robot.urdf", "log.csv", "--json", str(out)], cwd=sticky, check=True, capture_output=True)
    said = json.loads(out.read_text())
    assert [one["verdict"] for one in said.values()] == ["explained"] * 3
    assert list(said) == ["always_coulomb", "independent_bic", "mujoco_sysid"]
