"""Fits sets of columns with bounded nuisances, and computes gains of columns that are added to a fit."""
