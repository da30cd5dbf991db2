"""Haptic devices: one axis and its drive, stability, identification, transparency, sensing and cheaper hardware.

- `device`: one axis, rigid or of two masses, the hand that holds it, its sampled form, its drive; published devices.
- `stability`: largest stable stiffness of a virtual wall and largest gains; force feedforward and teleoperation.
- `sensing`: encoders, velocity estimators, and simulation of sampled loops.
- `experiments`: relay, white noise and swept sine, and the two-mass model fitted to a response.
- `cheap`: a good device made to feel like a cheaper one.
- `figures`: drawings of all of these.
"""
