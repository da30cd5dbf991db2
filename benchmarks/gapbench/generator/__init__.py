"""Robots, motions and recordings for the sealed cases.

Stands alone: MuJoCo moves the robots, and every law is written here from its equation. Nothing in this folder may
import `phantom_dyn`, `identification` or Pinocchio; a test runs it where such an import raises.
"""
