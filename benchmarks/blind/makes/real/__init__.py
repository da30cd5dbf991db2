"""Cases from real recordings: a known effect is added to one part of a recording, and its model fits the other part.

Noise, drives and friction are those of real robots. The effect to be found is known, because it was added. A recording
is cut into two parts. `phantom-dyn diagnose` finds what the robot's model lacks in part one, and corrects the model. A
case consists of part two with an added effect, and the corrected model. The laws of the effects are implemented here
from their equations, with NumPy and Pinocchio, and share no code with those of the project.

**Scoring.** The corrected model is not perfect, and a robot changes between the parts. So part two is also diagnosed
without an added effect. The findings of this diagnosis are the *context*, which every answer lists.

- A null is judged strictly: any claim counts as false. Some of these claims are true of the robot, so the share of
  false claims is an upper limit.
- The context may name a family of effects at a joint: friction, load, functions of position, or sensors and timing.
  No effect of this family is added at this joint, and findings of this family at this joint do not count, because
  nobody knows how much of such a finding is new.
- The verdict `unknown` counts only if the context has another verdict, or if nothing new is found.
- The noise floor is the residual of the corrected model in part two without an added effect. A gap is fully closed if
  the residual is at this floor.
"""
