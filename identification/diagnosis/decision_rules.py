"""Thresholds of noise, rivals, the verdict and bursts, each with its unit, reason and source.

The comment of a threshold begins with its unit. Thresholds of gates are in `identification.gates`. Thresholds of the
contract, which hold for torques, poses and rests, are in `identification.engine.contract_levels`.

``python benchmarks/same_answers.py record --rule NAME=VALUE`` diagnoses forty recordings with another value of one
threshold, and its ``compare`` prints which answers change.
"""

from __future__ import annotations

# Noise.

# probability: that the noise floor of any joint is outside its interval (contract: 5 % over all joints).
FLOOR_ERROR = 0.05

# gain: of an effect whose torque is fitted to the estimated noise. Above this gain the noise is estimated again without
# the effect.
LEAST_TRACE = 10.0

# ratio: of the new to the old noise floor. Below this ratio the search is repeated with the new noise.
LOWER_NOISE = 0.9

# exponent: power of the frequency with which the density of a noise that counts as white may rise or fall. A
# first-order filter makes a power of two.
FLAT_NOISE = 1.0

# times: the noise of the sensors plus the errors of the method. A larger residual is a gap and not noise, even if no
# model predicts it.
SENSOR_TIMES = 2.0

# share: of the usual velocity and of the travel of a joint, by which two repetitions of a motion may differ. The error
# of the model then differs by as little. The axis of EMPS and the double pendulum repeat theirs to 0.9 to 1.4 %.
REPEATED = 0.02

# Findings, in the judged band. `benchmarks/blind/run.py` shows extra findings and lost second effects.

# probability: that no compared size differs between two diagnoses by chance (Bonferroni over all compared sizes).
SIZES_DIFFER = 0.95

# share: of the noise floor. After the rounding of a coarse encoder is subtracted, at least this much is kept.
COARSE_REMAINDER = 0.3

# Rivals and their probabilities. `benchmarks/blind/run.py` shows how often the true cause is among finding and rivals,
# how many rivals there are, and how reliable their probabilities are.

# times: the stated tolerances. The comparison with rivals is repeated with tolerances this much wider, because stated
# tolerances are often guesses.
OTHER_TOLERANCE = 3.0

# gain: ten standard deviations of one parameter. A rival whose in-sample loss is larger than that of the finding by
# this leads in no bootstrap replicate and is left out.
HOPELESS_LOSS = 100.0

# standard errors over blocks, and loss: a rival whose held-out loss is larger than that of the finding by their sum is
# not compared.
HOPELESS_ERRORS, HOPELESS_BEYOND = 4.0, 4.0

# share: of the torque of the finding that an additional parameter of a law with more parameters is expected to make.
EXPECTED_SHARE = 0.5

# share: of the squared torque. Two causes count as the same if each can make the torque of the other except for this
# share. It is a tenth of the amplitude, like the residual of a law of the right kind with a parameter wrong by a tenth.
SAME_CAUSE = 0.01

# share: of the gain of a finding, or of the threshold. A rival that gains more than this is linearised about its own
# fit.
RUNNER_UP = 0.8

# probability: that another recording rules out one of two rivals. If it is lower for every safe motion, no motion is
# proposed, and a note says so. `benchmarks/next_experiment.py` compares proposed motions with random ones.
SEPARATED = 0.5

# Structures without a name, and the residual. `benchmarks/blind/run.py` shows how often causes inside and outside the
# catalogue get the verdict `unknown`.

# share: of the squared residual that a flexible model has to predict if the residual is to count as structured.
STRUCTURE_SHARE = 0.08

# standard errors over blocks: the predicted part has to be larger than this many.
STRUCTURE_ERRORS = 3.0

# share: a residual counts as structured if a larger share than this is predicted, whatever the standard error.
PLAIN_STRUCTURE = 0.5

# The verdict. Its table is the contract's; `tests/identification/diagnosis/judge/test_verdict.py` states every row.

# share: of the explainable gap. Less structure than this in the residual does not change the verdict, neither at rest
# nor in motion.
LITTLE_STRUCTURE = 0.1

# share: of the measured torque that an ordinary effect makes.
ORDINARY_SHARE = 0.1

# share: of the measured torque. A joint with more above its noise floor is not called free of a gap, however wide the
# interval of its noise is.
OPEN_SHARE = 0.5 * ORDINARY_SHARE

# share: of the limit. A change within tolerance above this share counts as at its limit, because solvers stop a
# rounding error before the limit.
AT_LIMIT = 0.999

# Bursts: pushes, contacts and other events that the state of the robot does not predict. No case of
# `benchmarks/blind/generate.py` has a burst, so every burst in their `data_warnings` is false.

# probability: of a false burst on any joint of a recording without an event.
BURST_LEVEL = 0.01

# s: lengths of the windows in which events are searched for.
BURST_LENGTHS = (0.15, 0.3, 0.6, 1.0)

# times: the residual that noise and errors of the model are expected to cause at that moment. A larger one is an event.
BURST_RATIO = 6.0

# times: the largest level elsewhere in the recording. An event has to exceed it by this factor. Stationary normal noise
# hardly ever reaches half of BURST_RATIO, so this matters only if the noise varies over the recording.
BURST_TIMES = 2.0

# share: of the moving part of the modelled torque beyond its usual size; least error of a fitted model. 0.07 to 0.2 %
# were measured at peaks of acceleration of simulated arms, whatever the band of the derivatives.
MODEL_SHARE = 0.001

# share: of the joint's largest burst. A smaller burst is an artefact of fits that have seen the largest one.
BURST_SHARE = 0.15

# share: of the highest level of a burst at which it begins and ends.
BURST_FLANK = 0.25

# Samples in which friction is uncertain.

# s: standard deviation of the time at which modelled friction changes sign: real joints stick or bend for
# milliseconds.
REVERSAL_TIME = 0.005

# s: longest time for which a joint may stick while its velocity passes through zero.
STANDING_TIME = 3.0 * REVERSAL_TIME

# counts: of the encoder, within which the reading of a joint at standstill stays: two, plus the overshoot of splines
# through rounded readings at uneven times.
STANDING_COUNTS = 2.2

# share: of the joint's usual speed. Motion by STANDING_COUNTS within the watched time has to be slower than this;
# otherwise the time is made longer, because slow motion would look like a standstill.
STANDING_SPEED = 0.25

# s: longest time over which a coarse encoder is watched for a standstill; joints that stop between moves rest longer.
STANDING_LONGEST = 0.3

# share: of a joint's top speed. A slower joint creeps.
CREEPING_SPEED = 0.05

# s: time before and after a reversal in which a joint always counts as creeping.
CREEPING_TIME = 0.05

# share: of friction, by which the friction of a creeping joint differs from a law: a joint breaks away at more than
# sliding friction, and reaches sliding friction only after some displacement.
CREEPING_FRICTION = 0.3

# share: of a joint's samples. If friction is certain in more of them, these alone decide whether the residual is noise.
SURE_SHARE = 0.2

# times: the standard deviation of its vibration. A joint that moves farther counts as travelling.
TRAVELS = 20.0

# share: of the fastest speeds. If noise of the velocity may be larger, the noise is estimated from the raw readings.
SHAKES = 0.1

# coherence: of torque and motion. A frequency with more counts as excited.
COHERENT = 0.7

# share: of all frequencies. If more are excited, a resonance is searched for.
EXCITED_SHARE = 0.2

# blocks: least number of blocks of at least a second each, which are held out in turn.
LEAST_BLOCKS = 4

# Recordings at rest.

# probability: that a shift between rests is as large by chance.
REST_CHANCE = 1e-3

# times: the end of the 99 % band of noise. If simulated motion differs by more, there is a gap, even if the torques do
# not show it. The band is estimated from few windows, and these magnify noise unequally: in recordings without a gap
# `rollout.strays` reached 1.6.
STRAYS_FAR = 2.0
