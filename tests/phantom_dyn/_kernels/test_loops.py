"""Compiled loops over samples against NumPy and SciPy.

What becomes of a function where numba is off, or has nowhere to keep its machine code, and in threads.
"""

import copy
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import numba
import numpy as np
import pytest
from scipy.signal import firwin, oaconvolve

from phantom_dyn._kernels import jit
from phantom_dyn._kernels.dry_friction import FrictionPlaces, apply_dry_friction, friction_on_motors
from phantom_dyn._kernels.fir import filtered
from phantom_dyn.simulation.compiled.arm_steps import spring_torque


def test_friction_stops_what_it_can_and_slips_with_its_limit_where_it_cannot(rng):
    # The conditions of Coulomb friction: |friction| <= limit; at rest below it; against the motion at it.
    for _ in range(20):
        half = rng.normal(size=(4, 4))
        mobility, free, most, h = half @ half.T + 0.5 * np.eye(4), rng.normal(size=4), rng.uniform(0.0, 80.0, 4), 1e-2
        speed, friction = free.copy(), rng.uniform(-1.0, 1.0, 4) * most
        apply_dry_friction(mobility, speed, friction_on_motors(np.arange(4), 4), friction, most, h)
        np.testing.assert_allclose(speed, free + mobility @ friction * h, atol=1e-7)
        sticks = np.abs(friction) < most
        assert np.all(speed[sticks] == 0.0)
        np.testing.assert_allclose(friction[~sticks], -np.sign(speed[~sticks]) * most[~sticks])


def test_without_friction_no_speed_changes(rng):
    speed = rng.normal(size=3)
    same = speed.copy()
    apply_dry_friction(np.eye(3), speed, friction_on_motors(np.arange(3), 3), np.zeros(3), np.zeros(3), 1e-3)
    np.testing.assert_array_equal(speed, same)


def test_a_passive_joint_rubs_as_a_motor_with_its_own_velocity_would(rng):
    # The same conditions in the velocities of all that rubs: two motors, and a joint that turns with both.
    turns = np.array([[1.0, 0.0], [0.0, 1.0], [0.7, -1.2]])
    for _ in range(20):
        half = rng.normal(size=(2, 2))
        mobility, free, most, h = half @ half.T + 0.5 * np.eye(2), rng.normal(size=2), rng.uniform(0.0, 60.0, 3), 1e-2
        speed, friction = free.copy(), np.zeros(3)
        apply_dry_friction(
            mobility, speed, FrictionPlaces(np.arange(2), turns[2:], np.zeros((1, 3))), friction, most, h
        )
        np.testing.assert_allclose(speed, free + mobility @ turns.T @ friction * h, atol=1e-7)
        rates = turns @ speed
        moves = np.abs(rates) > 1e-6
        assert np.all(np.abs(friction) <= most)
        np.testing.assert_allclose(friction[moves], -np.sign(rates[moves]) * most[moves])


KERNEL = np.array(firwin(31, 0.2), dtype=float)


@pytest.mark.parametrize("step", [1, 3, 7])
def test_samples_that_are_kept_are_those_of_a_whole_convolution(step):
    rng = np.random.default_rng(4)
    x, kernel = rng.normal(size=(200, 3)), KERNEL
    whole = np.array(oaconvolve(x, kernel[:, None], mode="valid", axes=0))
    np.testing.assert_allclose(filtered(kernel, x, step), whole[::step], atol=1e-14)


def test_a_record_shorter_than_the_kernel_has_no_sample_inside():
    assert filtered(KERNEL, np.ones((30, 2)), 2).shape == (0, 2)


@pytest.mark.parametrize("step", [1, 4])
def test_a_column_does_not_depend_on_its_neighbours(step):
    # Oracle: the column alone, to the last digit; a product of all columns rounds by how many there are.
    x = np.random.default_rng(5).normal(size=(1000, 7))
    together = filtered(KERNEL, x, step)
    for column in range(7):
        np.testing.assert_array_equal(together[:, column], filtered(KERNEL, x[:, [column]], step)[:, 0])


# A spring of 2 N m/rad that is wound up by half a radian: known in closed form.
SPRING = """
from phantom_dyn.simulation.compiled.arm_steps import spring_torque
print(spring_torque(0.5, 0.0, 2.0, 0.0, 0.0), hasattr(spring_torque, "signatures"))
"""


# Squares in an array that the compiled function allocates, and whether numba's means of compiling are loaded then.
SQUARES = """
import sys
import numpy as np
from phantom_dyn._kernels.jit import jit, watched_compilation

@jit
def squares(x):
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = x[i] * x[i]
    return out

if __name__ == "__main__":
    with watched_compilation() as count:
        for kind in sys.argv[1:]:
            print(squares(np.array([1, 2, 3], kind)).tolist(), count.functions > 0, "numba.np.linalg" in sys.modules)
"""


def twice(x: float) -> float:
    return 2 * x


def spring_in_a_fresh_process(**environment: str) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-c", SPRING]
    return subprocess.run(words, env=os.environ | environment, capture_output=True, text=True, check=True)


def no_cache(folder: Path) -> dict[str, str]:
    """Numba's words for a folder of the package and a home that cannot be written to, for any user, root included."""
    (folder / "file").touch()
    return {
        "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator",
        "NUMBA_CACHE_DIR": str(folder / "file" / "below"),
    }


@pytest.fixture(scope="module")
def uncached(tmp_path_factory):
    """What such a process prints."""
    return spring_in_a_fresh_process(**no_cache(tmp_path_factory.mktemp("no_cache")))


def test_a_function_is_compiled_where_no_folder_can_be_written_to(uncached):
    assert uncached.stdout.strip() == "1.0 True"


def test_one_sentence_says_that_nothing_is_kept(uncached):
    assert uncached.stderr.count("No folder for compiled loops can be written to") == 1
    assert "set the environment variable NUMBA_CACHE_DIR" in uncached.stderr


def test_what_has_another_reason_than_the_cache_is_not_hidden(monkeypatch):
    def njit(**options):
        raise RuntimeError("out of order")

    monkeypatch.setattr(jit, "njit", lambda: njit)
    with pytest.raises(RuntimeError, match="out of order"):
        jit.jit(twice)(1.0)


def test_with_numba_off_a_function_is_plain_python():
    done = spring_in_a_fresh_process(NUMBA_DISABLE_JIT="1")
    assert done.stdout.strip() == "1.0 False"


def test_threads_may_make_the_first_call_together():

    start, first = Barrier(4), jit.jit(twice)

    def call(x: float) -> float:
        start.wait(30)
        return first(x)

    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(call, (1.0, 2.0, 3.0, 4.0))) == [2.0, 4.0, 6.0, 8.0]


@pytest.mark.parametrize("decorator", [jit.inlined, jit.inlined_jit])
def test_a_part_is_called_by_compiled_functions_and_by_python(decorator):
    # Oracle: 2 * 3; a part without what Python's call needs would end the process.
    part = decorator(lambda x: 2 * x)

    @jit.jit
    def whole(x: float) -> float:
        return part(x)

    assert (whole(3.0), part(3.0)) == (6.0, 6.0)


def test_numba_is_loaded_by_the_first_call_and_not_before():
    words = (
        "import sys\nimport identification.pipeline\nfrom phantom_dyn.simulation.compiled import arm_steps\n"
        "print('numba' in sys.modules)\narm_steps.spring_torque(0.5, 0.0, 2.0, 0.0, 0.0)\n"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


def test_a_compiled_function_is_pickled_and_copied_by_its_name():
    assert pickle.loads(pickle.dumps(spring_torque)) is spring_torque
    assert copy.deepcopy(spring_torque) is spring_torque


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a script and its compiled functions are kept."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def squares(folder):
    """What a fresh process prints that squares numbers of some kinds; a first one has kept what squares doubles."""
    (folder / "squares.py").write_text(SQUARES)

    def printed(*kinds: str) -> list[str]:
        words = [sys.executable, str(folder / "squares.py"), *kinds]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": os.pathsep.join(sys.path)}
        return subprocess.run(words, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()

    assert printed("float64") == ["[1.0, 4.0, 9.0] True True"]
    return printed


def test_a_kept_function_is_loaded_without_what_only_compiling_needs(squares):
    assert squares("float64") == ["[1.0, 4.0, 9.0] False False"]


def test_beside_a_kept_function_others_are_compiled(squares):
    assert squares("float64", "int64") == ["[1.0, 4.0, 9.0] False False", "[1, 4, 9] True True"]
    assert squares("int64", "float64") == ["[1, 4, 9] False False", "[1.0, 4.0, 9.0] False False"]


def test_kept_functions_of_a_version_with_other_names_are_compiled_anew(folder, squares):
    # An index of numba is its version and a pickle; this one has a class that is not there any more.
    indices = [*(folder / "cache").rglob("*.nbi")]
    for index in indices:
        index.write_bytes(pickle.dumps(numba.__version__) + b"cphantom_dyn._kernels.jit\nGone\n.")
    assert indices
    assert squares("float64") == ["[1.0, 4.0, 9.0] True True"]
    assert squares("float64") == ["[1.0, 4.0, 9.0] False False"]


def test_a_numba_whose_cache_is_another_is_left_as_it_is():
    assert jit._with_fast_loading(twice) is twice
    assert not hasattr(twice, "load_overload")
