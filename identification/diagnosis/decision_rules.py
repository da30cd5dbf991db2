"""Thresholds other than those of gates: of noise, rivals, the verdict and bursts, each with unit, reason and source.

Thresholds of gates are in `identification.gates`, those of the contract for torques, poses and rests alike in
`identification.engine.contract_levels`. ``python benchmarks/same_answers.py record --rule NAME=VALUE`` diagnoses forty
recordings with another value of one of them, and its ``compare`` prints which answers change.
"""

from __future__ import annotations

# Noise.

# probability: that the floor of some joint lies outside its interval (contract: 5 % over all joints).
FLOOR_ERROR = 0.05

# gain: of an effect in the estimated noise. From here on the noise is estimated again without the effect.
LEAST_TRACE = 10.0

# ratio: of the new to the old noise floor, below which the search is repeated with the lower noise.
LOWER_NOISE = 0.9

# exponent: by which the density of a noise that counts as white may rise or fall with frequency; a first-order filter
# makes two.
FLAT_NOISE = 1.0

# times: the noise of the sensors plus the errors of the method. A residual that no model predicts and that is larger is
# a gap, not noise.
SENSOR_TIMES = 2.0

# share: of its usual velocity and of its way, by which a joint may differ between two repetitions of a motion. The
# error of the model then differs by as little. The axis of EMPS and the double pendulum repeat theirs to 0.9 to 1.4 %.
REPEATED = 0.02

# What is shown of a claim, in the judged band: extra findings and lost second effects in `benchmarks/blind/run.py`.

# probability: (Bonferroni) that no size differs between diagnoses by chance, over all sizes that are compared.
SIZES_DIFFER = 0.95

# share: of the noise floor. After the rounding of a coarse encoder is subtracted, at least this much is kept.
COARSE_REMAINDER = 0.3

# Rivals and their probabilities. Shown by `benchmarks/blind/run.py` (sets with the truth, their size, reliability).

# times: the stated tolerances. The comparison with rivals is repeated with these, as stated ones are often guesses.
OTHER_TOLERANCE = 3.0

# gain: ten deviations of one parameter. A rival that is worse by it in sample leads in no replicate and is left out.
HOPELESS_LOSS = 100.0

# standard errors over blocks, and loss beyond them: a rival that is worse by both on held-out data is not compared.
HOPELESS_ERRORS, HOPELESS_BEYOND = 4.0, 4.0

# share: of the torque of the finding that a further parameter of a richer law is expected to make (prior).
EXPECTED_SHARE = 0.5

# share: of the squared torque of two causes. They count as the same where either makes the torque of the other up to
# this: a tenth of the amplitude, as much as a law of the right kind leaves whose parameter is off by a tenth.
SAME_CAUSE = 0.01

# share: of the gain of a finding (or of the threshold). A rival that gains more is linearised about its own fit.
RUNNER_UP = 0.8

# probability: that a further recording rules out one of two rivals. Below it no motion is proposed, and a note says
# that no safe motion separates them. `benchmarks/next_experiment.py` compares proposed motions with random ones.
SEPARATED = 0.5

# Structures without a name, and the residual. Shown by `benchmarks/blind/run.py` (`unknown` inside and outside).

# share: of its loss by which a flexible model has to reduce a residual that counts as structured.
STRUCTURE_SHARE = 0.08

# standard errors over blocks: least size of that reduction.
STRUCTURE_ERRORS = 3.0

# share: above which the residual is structured whatever its standard error.
PLAIN_STRUCTURE = 0.5

# The verdict. Its table is the contract's; `tests/identification/diagnosis/judge/test_verdict.py` states every row.

# share: of the explainable gap, below which remaining structure does not change the verdict, at rest as in motion.
LITTLE_STRUCTURE = 0.1

# share: of the measured torque, as an ordinary effect makes it.
ORDINARY_SHARE = 0.1

# share: of the measured torque. A joint with more above its noise floor is not called free of a gap, however wide the
# interval of its noise is.
OPEN_SHARE = 0.5 * ORDINARY_SHARE

# share: of its limit above which a change within tolerance counts as at the limit; solvers stop a rounding error short
# of it.
AT_LIMIT = 0.999

# Bursts: pushes, contacts and other events that the state of the robot does not predict. `data_warnings` of the cases
# of `benchmarks/blind/generate.py`, none of which has one, show false ones.

# probability: of a false burst on any joint of a recording without an event.
BURST_LEVEL = 0.01

# s: windows in which events are searched for.
BURST_LENGTHS = (0.15, 0.3, 0.6, 1.0)

# times: the expected residual at that moment, by noise and errors of the model, above which it is an event.
BURST_RATIO = 6.0

# times: the largest level elsewhere in the recording that an event has to exceed. Stationary normal noise hardly ever
# reaches half of BURST_RATIO, so that this matters only where the noise is louder at some moments.
BURST_TIMES = 2.0

# share: of the moving part of the modelled torque beyond its usual size; the least error of a fitted model. 0.07 to
# 0.2 % were measured at peaks of acceleration of simulated arms, whatever the band of the derivatives.
MODEL_SHARE = 0.001

# share: of the joint's largest burst. A smaller burst is an artefact of fits that have seen the largest one.
BURST_SHARE = 0.15

# share: of the highest level of a burst at which it begins and ends.
BURST_FLANK = 0.25

# Samples in which friction is uncertain.

# s: standard deviation of the time at which modelled friction changes sign: real joints stick or bend for
# milliseconds.
REVERSAL_TIME = 0.005

# s: so long a joint may stick while its velocity seems to pass through zero.
STANDING_TIME = 3.0 * REVERSAL_TIME

# counts: of the encoder, within which the reading of a standing joint stays: two, and the overshoot of splines through
# rounded readings at uneven times.
STANDING_COUNTS = 2.2

# share: of the joint's usual speed. Where so few counts in that time are a higher speed, the encoder is too coarse to
# show a standstill so quickly.
STANDING_SPEED = 0.25

# s: longest time over which a coarse encoder is watched for a standstill; joints that stop between moves stand longer.
STANDING_LONGEST = 0.3

# share: of a joint's top speed, below which it creeps.
CREEPING_SPEED = 0.05

# s: before and behind a reversal, in which a joint creeps however it is driven.
CREEPING_TIME = 0.05

# share: of friction, by which that of a creeping joint differs from a law: it breaks away at more than sliding
# friction, which is reached over some displacement.
CREEPING_FRICTION = 0.3

# share: of a joint's samples. If friction is certain in more of them, these alone decide whether the residual is noise.
SURE_SHARE = 0.2

# times: the deviation of its vibration that a joint has to move to count as travelling.
TRAVELS = 20.0

# share: of the fastest speeds. Where noise may make more, moving joints are found from the raw readings.
SHAKES = 0.1

# coherence: of torque and motion, at which a frequency counts as excited.
COHERENT = 0.7

# share: of all frequencies. Where more are excited, a resonance is searched for.
EXCITED_SHARE = 0.2

# blocks: least number, of at least a second each, that are held out in turn.
LEAST_BLOCKS = 4

# Recordings at rest.

# probability: of a shift as large between rests by chance.
REST_CHANCE = 1e-3

# times the end of the 99 % band: above which simulated motion that leaves its noise band is a gap, though no torque
# shows it. The band is estimated from as few windows as it is applied to, and these magnify noise unequally: the
# `rollout.strays` of sealed nulls reached 1.6.
STRAYS_FAR = 2.0
