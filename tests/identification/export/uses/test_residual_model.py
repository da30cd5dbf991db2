"""The residual model as plain Python. Oracles: the library's own columns, and MuJoCo on data that no fit has seen."""

import csv
import io
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import phantom_dyn as dyn
from benchmarks.laws.cases import make
from identification.diagnosis.law.find_law import law_of, residual_terms
from identification.diagnosis.law.library import library
from identification.diagnosis.residual_law import Dependence, ModelTerm, ResidualModel
from identification.diagnosis.result import JointGap, Unexplained
from identification.export.uses.feedforward import loaded
from identification.export.uses.residual_model import residual_code, residual_note, residual_table
from identification.words.note_words import sentence
from made_up_residual import made_up_residual
from phantom_dyn.signals.recursive import lagging

SPRING = ResidualModel(
    "j1", "N m", (ModelTerm("q", "x['q.j1']", -2.0), ModelTerm("sign(v)", "side(x['v.j1'])", -0.5)), (),
    {"q.j1": (-1.0, 1.0), "v.j1": (-2.0, 2.0)}, 0.9, True, 0.01,
)  # fmt: skip
RESIDUAL = made_up_residual(lambda x: 0.0 * x["t"], seconds=9.0)
HELD_OUT_S = 15.0


def test_every_term_of_the_library_is_the_same_in_the_file():
    log = RESIDUAL.logs[0]
    every = {name: (-1e9, 1e9) for name in log.inputs}
    others = []
    for term in library(RESIDUAL):
        terms, states = residual_terms(RESIDUAL, [(text, 1.0) for text in term.texts])
        law = loaded(residual_code(replace(SPRING, terms=terms, states=states, valid=every, slow=1e-9)))
        wanted = np.sum([column(log) for column in term.columns], axis=0)
        along = law["Residual"]().along(log.inputs)
        if not np.allclose(along, wanted, rtol=1e-6, atol=1e-6 * np.ptp(wanted)):
            others.append(term.texts[0])
    assert others == []


def test_the_file_needs_numpy_alone(tmp_path):
    (tmp_path / "residual.py").write_text(residual_code(SPRING), encoding="utf-8")
    script = (
        "import sys, residual; print(residual.Residual().torque({'t': 0.0, 'q.j1': 0.5, 'v.j1': 1.0}));"
        "loaded = {name.split('.')[0] for name in sys.modules};"
        "print(sorted(loaded & {'scipy', 'pinocchio', 'identification', 'phantom_dyn', 'numba'}))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["-1.5", "[]"]


def test_it_says_which_inputs_are_beyond_the_data():
    assert loaded(residual_code(SPRING))["outside"]({"q.j1": 1.5, "v.j1": 0.0}) == ("q.j1",)


def test_beyond_the_data_the_end_of_the_range_holds():
    torque = loaded(residual_code(SPRING))["Residual"]().torque
    assert torque({"t": 0.0, "q.j1": 7.0, "v.j1": 1.0}) == pytest.approx(-2.5)


def test_a_name_with_quotes_is_only_a_name():
    residual = replace(RESIDUAL, joint='it\'s "j"')
    terms, states = residual_terms(residual, [("(q - 0.1)*sign(v)", 2.0)])
    model = replace(
        SPRING, joint=residual.joint, terms=terms, states=states, valid={f"q.{residual.joint}": (-1.0, 1.0)}
    )
    x = {f"q.{residual.joint}": 0.6, f"v.{residual.joint}": 1.0}
    assert sum(loaded(residual_code(model))["terms"](x, [])) == pytest.approx(1.0)


def test_the_table_holds_the_torque_of_the_file(made_up):
    found = Dependence("j1", "N m", ("q.j1", "v.j1"), (), (), model=SPRING)
    diagnosis = replace(made_up(), unexplained=Unexplained(0.4, True, "j1", None, dependence=found))
    rows = list(csv.DictReader(io.StringIO(residual_table(SPRING, diagnosis))))
    for row in rows[:: len(rows) // 20]:
        q, v = float(row["q.j1"]), float(row["v.j1"])
        assert float(row["torque"]) == pytest.approx(-2.0 * q - 0.5 * np.tanh(v / 0.01))


def test_an_answer_with_memory_is_in_the_model_and_its_frequencies_in_the_text():
    residual = made_up_residual(lambda x: 3.0 * lagging(x["v.j1"], 0.02, 0.4))
    _, found = law_of(residual, (JointGap("j1", "N m", 1.0, 1.0, 0.1, 1200),))
    code = residual_code(found.model)
    log = residual.logs[0]
    assert "Low('v.j1', " in code
    assert "Its response to 'v.j1' has memory" in code
    along = loaded(code)["Residual"]().along(log.inputs)
    np.testing.assert_allclose(along[50:], -3.0 * lagging(log.inputs["v.j1"], 0.02, 0.4)[50:], atol=0.4)


def test_the_table_says_that_it_has_no_memory(made_up):
    model = replace(
        SPRING, terms=(ModelTerm("low(v, 1 Hz)", "s[0]", -2.0),), states=("Low('v.j1', 1.0)",),
        valid={"v.j1": (-2.0, 2.0)}, bands={"freq(v.j1)": (0.1, 1.0)},
    )  # fmt: skip
    found = Dependence("j1", "N m", ("freq(v.j1)",), (), (), model=model)
    diagnosis = replace(made_up(), unexplained=Unexplained(0.4, True, "j1", None, dependence=found))
    for row in csv.DictReader(io.StringIO(residual_table(model, diagnosis))):
        assert float(row["torque"]) == pytest.approx(-2.0 * float(row["v.j1"]))
    assert "It depends on past inputs" in sentence(residual_note(model))
    assert "past inputs" not in sentence(residual_note(SPRING))


def test_the_law_is_in_the_model_to_use():
    residual = made_up_residual(lambda x: (2.0 - 0.05 * (x["t"] - 12.0)) * np.sign(x["v.j1"]))
    _, found = law_of(residual, (JointGap("j1", "N m", 1.0, 1.0, 0.1, 1200),))
    assert found.model.contains_law
    assert {"sign(v)", "(t - 12)*sign(v)"} <= {term.text for term in found.model.terms}


@pytest.fixture(scope="module")
def part_of_a_recording(tmp_path_factory):
    """Files of a diagnosis that has seen the first part of a recording of a spring that hardens, and the recording."""
    folder = tmp_path_factory.mktemp("spring")
    make(8, folder)
    log = np.genfromtxt(folder / "log.csv", delimiter=",", names=True, deletechars="")
    head, *rows = (folder / "log.csv").read_text().splitlines()
    (folder / "first.csv").write_text("\n".join([head, *rows[: int(np.sum(log["t"] < HELD_OUT_S))]]) + "\n")
    dyn.diagnose(folder / "robot.urdf", folder / "first.csv").save(folder / "out")
    return folder / "out", log


def strays(folder, log, residual) -> float:
    """Root mean square distance of simulated from recorded positions, over shots of half a second on unseen data."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(folder / "corrected.xml"))
    data = mujoco.MjData(model)
    names = [model.joint(k).name for k in range(model.njnt)]
    step = log["t"][1] - log["t"][0]
    model.opt.timestep = step / 4
    q, tau = (np.column_stack([log[f"{kind}.{name}"] for name in names]) for kind in ("q", "tau"))
    v = np.gradient(q, step, axis=0)
    unseen, shot = int(HELD_OUT_S / step) + 10, int(0.5 / step)
    errors = []
    for start in range(unseen, len(q) - shot, shot):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = q[start], v[start]
        lacking = None if residual is None else residual["Residual"]()
        for k in range(start, start + shot):
            for _ in range(4):
                data.qfrc_applied[:] = tau[k]
                if lacking is not None:
                    x = {"t": log["t"][start] - log["t"][0] + data.time}
                    for j, name in enumerate(names):
                        x |= {f"q.{name}": data.qpos[j], f"v.{name}": data.qvel[j], f"tau.{name}": tau[k, j]}
                    data.qfrc_applied[names.index(residual["JOINT"])] += lacking.torque(x)
                mujoco.mj_step(model, data)
            errors.append(data.qpos - q[k + 1])
    return float(np.sqrt(np.mean(np.square(errors))))


def test_mujoco_strays_less_with_it_on_data_that_no_fit_has_seen(part_of_a_recording):
    pytest.importorskip("mujoco")
    folder, log = part_of_a_recording
    law = loaded((folder / "residual.py").read_text(encoding="utf-8"))
    # A spring that hardens, from three quarters of the recording: 0.56 of the way.
    assert strays(folder, log, law) < 0.7 * strays(folder, log, None)
