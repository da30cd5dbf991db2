"""Haptic devices: one axis and its drive, stability, identification, transparency, sensing and cheaper hardware.

- `device`: one axis, rigid or of two masses, the hand that holds it, its sampled form, its drive; published devices.
- `stability`: how stiff a virtual wall and how large a gain a sampled device bears; force feedback and teleoperation.
- `sensing`: encoders, velocity estimators, and sampled loops in time.
- `experiments`: relay and white noise, and the two-mass model that fits a response.
- `cheap`: a good device made to feel like a cheaper one.
- `figures`: drawings of all of these.
"""
