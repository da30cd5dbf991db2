"""Bad input to the haptics is one sentence that says what was given and what to give."""

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis, CoggingTorque, StickingFriction
from phantom_dyn.haptics.cheap.cheap_hardware import at_rest, rendered, run_cycle
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, RigidAxis, masses_from_resonance
from phantom_dyn.haptics.device.drives import warming
from phantom_dyn.haptics.device.transfer_function import TransferFunction
from phantom_dyn.haptics.experiments.frequency_response import estimate_frequency_response
from phantom_dyn.haptics.experiments.noise_and_sweep import simulate_white_noise
from phantom_dyn.haptics.experiments.relay import RelayExperiment, limit_cycle, simulate_relay
from phantom_dyn.haptics.sensing.encoder import Encoder, record_motion
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings, simulate_loop
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import (
    STOCK,
    AveragedDifference,
    KalmanVelocity,
    PeriodMeasurement,
    kalman_gains,
)
from phantom_dyn.haptics.stability.critical_stiffness import (
    critical_stiffness,
    linear_ratio,
    linear_stiffness,
    stability_map,
)
from phantom_dyn.haptics.stability.force_feedforward import Feedforward, felt_mass, low_pass, transparency
from phantom_dyn.haptics.stability.sampled_loop import SampledLoop
from phantom_dyn.haptics.stability.virtual_wall import (
    simulate_damping,
    simulate_teleoperation,
    simulate_wall,
)
from phantom_dyn.number_checks import require_columns, require_whole, sample_count

# As a user has it: without the checker of shapes.
pytestmark = pytest.mark.whole

NAN, INF, T = math.nan, math.inf, 1e-3
AXIS = RigidAxis(1.0, 2.0)
GOOD = CheapAxis()
TEN = np.arange(10) * T
NOUGHT = np.zeros(10)
NOISE = np.random.default_rng(3).normal(size=1000)


def relay(**changed):
    return simulate_relay(AXIS, **({"period": T, "force": 1.0, "start": 0.0, "duration": 1.0} | changed))


def white(**changed):
    settings = {"period": T, "force": 1.0, "position_noise": 0.0, "duration": 1.0}
    return simulate_white_noise(AXIS, **(settings | changed), rng=np.random.default_rng(0))


def cycle(force, position):
    return limit_cycle(RelayExperiment(T, 0.0, np.arange(1000) * T, force, position))


def one_device(**changed):
    settings = {"gain": 1.0, "damping": 0.0, "start": (0.0,), "speed": (0.0,), "hand": np.zeros((10, 1))}
    return simulate_loop((AXIS,), LoopSettings(), **(settings | changed))


def warm(**changed):
    settings = {"heat_pulses": 2.0, "heat_linear": 1.0, "resistance": 1.0, "time_constant": 1.0, "t": TEN}
    return warming(**(settings | changed))


REFUSED = {
    "masses": (lambda: masses_from_resonance(1.0, -1.0, 1.0), "stiffness is -1.*: give a number above 0"),
    "resonance": (lambda: masses_from_resonance(1.0, 1.0, 0.0), "resonance is 0.*: give a number above 0"),
    "bare spring": (lambda: critical_stiffness(TransferFunction(np.ones(1), np.ones(1)), period=T), "has no state"),
    "wall damping": (lambda: critical_stiffness(AXIS, period=T, virtual_damping=NAN), "virtual damping is nan"),
    "linear": (lambda: linear_stiffness(NAN, period=T), "damping is nan: give a finite number"),
    "linear period": (lambda: linear_stiffness(1.0, period=INF), "give a positive period"),
    "map scalar": (lambda: stability_map(AXIS, period=T), "period of the map is 0.001: give a sequence"),  # type: ignore
    "map damping": (lambda: stability_map(AXIS, period=[T], virtual_damping=[NAN]), "virtual damping is nan"),
    "relay start": (lambda: relay(start=NAN), "start is nan"),
    "relay force": (lambda: relay(force=INF), "force of the relay is inf"),
    "relay period": (lambda: relay(period=0.0), "period is 0.*: give a number above 0"),
    "relay duration": (lambda: relay(duration=NAN), "duration is nan"),
    "relay late": (lambda: limit_cycle(relay(delay=2.0)), "never switches"),
    "relay positions": (lambda: cycle(np.ones(1000), np.full(1000, NAN)), "position is nan at sample 0"),
    "relay lengths": (lambda: cycle(np.ones(1000), np.ones(900)), r"position has the shape \(900,\)"),
    "noise period": (lambda: white(period=0.0), "period is 0"),
    "noise duration": (lambda: white(duration=-1.0), "duration is -1"),
    "noise short": (lambda: white(period=1.0, duration=0.1), "at least one period"),
    "noise long": (lambda: white(duration=1e300), "at most 100000000 periods"),
    "noise force": (lambda: white(force=NAN), "force is nan"),
    "noise reading": (lambda: white(position_noise=-1.0), "position noise is -1"),
    "response": (
        lambda: estimate_frequency_response(np.full(1000, NAN), NOISE, period=T, segment=0.1),
        "force is nan at sample 0",
    ),
    "response still": (
        lambda: estimate_frequency_response(NOISE, np.ones(1000), period=T, segment=0.1),
        "position never answers the force",
    ),
    "response period": (lambda: estimate_frequency_response(NOISE, NOISE, period=0.0, segment=0.1), "period is 0"),
    "response segment": (lambda: estimate_frequency_response(NOISE, NOISE, period=T, segment=NAN), "segment is nan"),
    "filter order": (lambda: low_pass(10.0, period=T, order=0), "give a whole number of 1 or more"),
    "filter period": (lambda: low_pass(10.0, period=0.0), "period is 0"),
    "felt mass": (lambda: felt_mass(1.0, -1.0), "give a number above -1"),
    "felt mass itself": (lambda: felt_mass(NAN, 1.0), "mass is nan kg"),
    "transparency gain": (
        lambda: transparency(AXIS, YOKOKOHJI_YOSHIKAWA, Feedforward(), NAN, np.ones(1)),
        "force gain is nan",
    ),
    "transparency frequency": (
        lambda: transparency(AXIS, YOKOKOHJI_YOSHIKAWA, Feedforward(), 1.0, np.array([NAN])),
        "needs frequencies above 0",
    ),
    "cogging": (lambda: CoggingTorque((NAN,), (1.0,), (0.0,)), "order of a cogging torque is nan"),
    "static ratio": (lambda: StickingFriction(1.0, 1.0, 1.0, 0.5), "static_ratio .* is 0.5: give 1 or more"),
    "rendered empty": (lambda: rendered(GOOD, np.zeros(0), np.zeros(0), np.zeros(0)), "one or more samples"),
    "rendered length": (
        lambda: rendered(GOOD, TEN, NOUGHT, np.zeros(3)),
        r"force has the shape \(3,\): give one number for each of 10 samples",
    ),
    "hole": (lambda: require_columns(3, some_column=np.array([0.0, 1.0, INF])), "some column is inf at sample 2"),
    "rendered NaN": (lambda: rendered(GOOD, TEN, np.full(10, NAN), NOUGHT), "position of the probe is nan at sample 0"),
    "felt time": (lambda: run_cycle(GOOD, at_rest(), -1.0, 0.0, 0.0), "time step is -1"),
    "felt slow": (lambda: run_cycle(GOOD, at_rest(), 1.0, 0.0, 0.0), "give more than 140 samples a second"),
    "felt NaN": (lambda: run_cycle(GOOD, at_rest(), T, NAN, 0.0), "position of the probe is nan"),
    "window": (lambda: AveragedDifference(2.5), "samples is 2.5: give a whole number"),  # type: ignore
    "counter": (lambda: PeriodMeasurement(bits=2.5), "counter of 2.5 bits"),  # type: ignore
    "kalman": (lambda: kalman_gains(KalmanVelocity(), step=0.0, period=T), "encoder step is 0"),
    "record": (lambda: record_motion(Encoder(), NOUGHT, interval=0.0, samples_apart=1), "interval is 0"),
    "record edges": (
        lambda: record_motion(Encoder(1e-12), np.array([0.0, 1.0]), interval=T, samples_apart=1),
        r"passes 1e\+12 edges",
    ),
    "figures": (
        lambda: estimator_figures(STOCK, Encoder(), speed=0.1, acceleration=1.0, period=10.0),
        "at least one period",
    ),
    "warming": (lambda: warm(heat_pulses=NAN), "heat under pulses is nan"),
    "warming before": (lambda: warm(t=-TEN), "seconds of 0 or more"),
    "no loop": (lambda: SampledLoop(()), "has no device"),
    "loop gain": (lambda: one_device(gain=NAN), "gain is nan"),
    "loop start": (lambda: one_device(start=(NAN,)), "start is nan"),
    "loop hand": (lambda: one_device(hand=np.full((10, 1), NAN)), "force of the hand is nan at sample 0"),
    "loop short": (
        lambda: one_device(hand=np.zeros((5, 1))).keeps_swinging(T),
        "5 samples are too few to see an oscillation",
    ),
    "damper": (lambda: simulate_damping(AXIS, LoopSettings(), 1.0, duration=-1.0), "duration is -1"),
    "wall": (lambda: simulate_wall(AXIS, LoopSettings(), 1.0, duration=NAN), "duration is nan"),
    "teleoperation": (
        lambda: simulate_teleoperation(AXIS, AXIS, LoopSettings(), 1.0, duration=1e-5),
        "at least one period",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_input_is_refused_in_a_sentence(name):
    call, words = REFUSED[name]
    with pytest.raises(ParameterError, match=words) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_samples_are_counted_to_the_nearest():
    assert [sample_count(duration, T) for duration in (1.0, 0.9994, 1e-3)] == [1000, 999, 1]


@pytest.mark.parametrize("value", [1.5, 0, NAN, INF])
def test_no_whole_number_above_zero(value):
    with pytest.raises(ParameterError, match="give a whole number of 1 or more"):
        require_whole(1, order=value)


def test_no_damping_at_all_has_no_ratio_to_the_linear_condition():
    free = RigidAxis(1.0, 0.0)
    assert math.isnan(linear_ratio(free, period=T))
    assert np.isnan(stability_map(free, period=[T]).ratio).all()


def test_a_loop_that_runs_away_within_a_sample_ends_there():
    # Counting a million million edges on the way would take hours.
    trace = simulate_damping(AXIS, LoopSettings(), -1e13, duration=0.1)
    assert trace.ran_away
    assert np.isfinite(trace.position).all()
