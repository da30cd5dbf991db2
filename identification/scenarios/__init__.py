"""Recordings that differ, recordings without torque, recordings at rest."""
