"""Experiments for parameters that one recording cannot separate: friction tests, tests with a held arm, CEA tests."""
