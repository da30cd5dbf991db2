"""Cases from real recordings: known effects put into one part of a recording, given the model that the other part made.

Noise, drives and friction are those of real robots, and what is to be found is known, because it was added. A
recording is cut into two parts. `phantom-dyn diagnose` finds what the robot's model lacks in part one; the model
corrected by that is what is given for part two, into whose columns an effect was put. The laws of the effects are
written here from their equations, on NumPy and Pinocchio, and share nothing with those of the project.

**What is fair.** The corrected model is not perfect, and a robot changes: what a diagnosis of part two claims while
nothing has been added is its *context*, listed in every answer.

- A null is judged strictly: any claim on it counts as false. Some of these claims will be true of the robot, so that
  the share of false claims is an upper limit.
- Where the context names a family of effects (friction, load, what goes with position, sensors and timing) at a joint,
  an effect of this family is not drawn there, and a finding of this family there is not counted, neither as right nor
  as wrong: nobody can say how much of it is new.
- The verdict `unknown` counts only where the context's verdict is another one or nothing new is found.
- A noise floor is what the corrected model leaves of part two while nothing is added, and gaps are closed down to that.
"""
