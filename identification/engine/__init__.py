"""Searches for the few columns that explain a residual on held-out data; contains no robot model.

- Residual: samples of several rows, one row for each joint (or coordinate of a pose).
- Column: samples that the residual would have if one coefficient were 1. A candidate effect is a set of columns.
- Nuisance: a column of every fit that is no candidate effect, such as a mass within its tolerance. Its coefficient has
  a Gaussian prior.
- Loss: sum of squared residuals in units of the noise variance, plus the penalties of the priors.
- Gain: decrease of the loss when columns are added to a fit.
- Block: a stretch of consecutive samples of one log. Its core leaves out the first samples, which share noise with the
  previous block. Losses are computed on cores.
- Fold: blocks that are held out together. A block with fold -1 is in no fit; all other blocks are training blocks.
- Gram matrix ``a``: products columns times columns. ``b``: columns times residual. ``c``: residual times residual.

Axes of arrays: ``K`` all columns, ``k`` columns of one fit, ``B`` blocks, ``F`` folds, ``R`` replicates or residuals.
"""
