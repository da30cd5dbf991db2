"""Recordings without torque: what the stated controllers ask for takes its place, and what that leaves open."""
