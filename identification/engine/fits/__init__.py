"""Fits of sets of columns with bounded nuisances, and gains of columns that are added to a fit."""
