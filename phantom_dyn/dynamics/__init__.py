"""Rigid-body dynamics and kinematics of whole trajectories, closed chains included."""
