"""Searches for the set of effects that explains the recordings, and for rivals that may explain them as well.

- Term: one effect on one joint with one shape (see `identification.diagnosis.columns.terms`). Its columns are the
  torque that it adds per unit of each coefficient. ``chosen`` is a set of terms.
- Row: one joint's torque, because its samples are one row of equations.
- Loss: sum of squared residuals in units of the noise variance, plus penalties on changes of the model within its
  tolerances. A held-out loss is computed on blocks of samples that the fit has not used.
- Gain: decrease of the loss when effects are added to a set.
- Score of a set: its held-out loss plus the price of its parameters. A smaller score is better.
- Claim: the statement that effects are present. A gate is a test that a claim has to pass. A finding is a claimed
  effect.
- Rival of a finding: effects that may explain the recordings in its place.
- Special case: a law with fewer parameters to which another law reduces. The other law contains the special case.
- Near twins: effects that make nearly the same torque.
- Structure without a name: columns that match no effect of the catalogue, for causes outside of it.
- Record: the results of gates for each effect.
"""
