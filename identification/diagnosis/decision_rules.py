"""Thresholds that decide no claim, as those of noise, rivals, the verdict and bursts: value, unit, reason, source.

What a claim has to pass stands with its thresholds in `identification.gates`, and what the contract has in
common for torques, poses and rests in `identification.engine.contract_levels`. ``python benchmarks/same_answers.py
record --rule NAME=VALUE`` judges forty recordings with another value of one of them, and its ``compare`` prints which
answers change.
"""

from __future__ import annotations

# Noise.

# probability: that the floor of some joint lies outside its interval (contract: 5 % over all joints).
FLOOR_ERROR = 0.05

# gain: of the trace of an effect in the noise, from which on the noise is estimated again without it.
LEAST_TRACE = 10.0

# ratio: of noise floors, below which an explanation has shown the noise to be smaller than estimated.
LOWER_NOISE = 0.9

# power of the frequency by which the density of a white noise may rise or fall: a first-order filter makes two.
FLAT_NOISE = 1.0

# times: the noise of the sensors and what the method is accurate to, beyond which what no model predicts is a gap.
SENSOR_TIMES = 2.0

# share: of its usual velocity and of its way, by which a joint may differ between two repetitions of a motion. What the
# model is wrong by then differs by as little. The axis of EMPS and the double pendulum repeat theirs to 0.9 to 1.4 %.
REPEATED = 0.02

# What is shown of a claim, in the judged band: extra findings and lost second effects in `benchmarks/blind/run.py`.

# probability: (Bonferroni) that chance makes no size differ between diagnoses, over all sizes that are compared.
SIZES_DIFFER = 0.95

# share: of the floor below which it is not known once the rounding is taken out.
COARSE_REMAINDER = 0.3

# Rivals and their probabilities. Shown by `benchmarks/blind/run.py` (sets with the truth, their size, reliability).

# times: the stated tolerances, under which the comparison with rivals is repeated: what they are is often a guess.
OTHER_TOLERANCE = 3.0

# gain: by which a rival is worse in sample, ten deviations of one parameter: it wins no replicate.
HOPELESS_LOSS = 100.0

# errors over blocks, and loss beyond these: by which a rival is worse held out: it is no longer compared.
HOPELESS_ERRORS, HOPELESS_BEYOND = 4.0, 4.0

# share: of the torque that was found which a further parameter of a richer law is expected to carry.
EXPECTED_SHARE = 0.5

# share: of the squared torque of either of two causes, below which the other one makes it as well: a tenth of the
# amplitude, as much as a law of the right kind leaves whose parameter is off by a tenth.
SAME_CAUSE = 0.01

# share: of the gain of a finding (or of the threshold) from which on a rival's law is taken again about its fit.
RUNNER_UP = 0.8

# probability: that a further recording strikes off one of two rivals, from which on it is proposed for them; below it
# a note says in its place that no safe motion separates them. What is more likely to fail than not is no advice.
# `benchmarks/next_experiment.py` compares what is proposed with random motions.
SEPARATED = 0.5

# Structures without a name, and what is left. Shown by `benchmarks/blind/run.py` (`unknown` inside and outside).

# share: of the loss that a flexible model takes off a residual that has structure.
STRUCTURE_SHARE = 0.08

# standard errors over blocks: of the same.
STRUCTURE_ERRORS = 3.0

# share: from which on it has structure in however few blocks.
PLAIN_STRUCTURE = 0.5

# The verdict. Its table is the contract's; `tests/identification/diagnosis/judge/test_verdict.py` states every row.

# share: of the explainable gap, below which structure that is left does not change the verdict.
LITTLE_STRUCTURE = 0.1

# share: of the measured torque that an ordinary effect makes.
ORDINARY_SHARE = 0.1

# share: of its limit from which on a move counts as being there; solvers stop a rounding short of it.
AT_LIMIT = 0.999

# Bursts: pushes, contacts and other events that nothing in the state of the robot foretells. `data_warnings` of the
# cases of `benchmarks/blind/generate.py`, none of which holds one, show false ones.

# probability: that chance makes one on any joint of a recording without an event.
BURST_LEVEL = 0.01

# s: lengths of the events that are looked for.
BURST_LENGTHS = (0.15, 0.3, 0.6, 1.0)

# times the torque that noise and the model's error are expected to leave at that moment.
BURST_RATIO = 6.0

# times: the largest level elsewhere, by which an event is larger. Normal noise of one size hardly ever comes to half of
# BURST_RATIO, so that this asks more only where the noise is louder at some moments.
BURST_TIMES = 2.0

# share: of what the moving part of the modelled torque is beyond its usual size, that a fitted model is wrong by at
# least: 0.07 to 0.2 % were measured at peaks of acceleration of simulated arms, whatever the band of the derivatives.
MODEL_SHARE = 0.001

# share: of the joint's largest burst, below which another one is what it does to the fits that have seen it.
BURST_SHARE = 0.15

# share: of the highest level of a burst, down to which it lasts.
BURST_FLANK = 0.25

# Samples that say little.

# s: standard deviation of the time at which modelled friction changes sign: real joints stick or bend for
# milliseconds.
REVERSAL_TIME = 0.005

# s: three of these deviations: as long as a joint may stick while it seems to pass through zero.
STANDING_TIME = 0.015

# counts: of the encoder, within which a reading may stay while the joint stands.
STANDING_COUNTS = 2

# share: of the joint's usual speed, above which so few counts in that time are its way of moving, not a standstill.
STANDING_SPEED = 0.25

# s: over which a coarse encoder may have to stay for that; no joint that stops between moves stands for much less.
STANDING_LONGEST = 0.3

# share: of a joint's top speed, below which it creeps.
CREEPING_SPEED = 0.05

# s: before and behind a reversal, in which a joint creeps however it is driven.
CREEPING_TIME = 0.05

# share: of friction, by which that of a joint that creeps differs from a law: it breaks away at more than it slides at,
# and comes up over some way.
CREEPING_FRICTION = 0.3

# share: of a joint's samples in which friction is not in doubt, from which on these say whether it has more than noise
# left.
SURE_SHARE = 0.2

# times: as far as the deviation of what shakes it: a joint that travels, and is not only shaken.
TRAVELS = 20.0

# share: of the fastest speeds that is taken for noise, from which on the raw readings are asked.
SHAKES = 0.1

# coherence: of torque and motion, at which a frequency counts as excited.
COHERENT = 0.7

# share: of all frequencies that are excited, from which on a resonance is looked for.
EXCITED_SHARE = 0.2

# blocks: of at least a second that can be held out in turn.
LEAST_BLOCKS = 4

# Judged at rest.

# probability: that chance makes rests give way as much.
REST_CHANCE = 1e-3

# share: of the explainable gap, from which on what is left has a cause of its own.
REST_STRUCTURE = 0.1

# times the end of the 99 % band: from which on simulated motion that strays is a gap, though no torque shows it. The
# band is made from as few windows as it judges, and these magnify noise unequally: the `rollout.strays` of sealed nulls
# reached 1.6.
STRAYS_FAR = 2.0
