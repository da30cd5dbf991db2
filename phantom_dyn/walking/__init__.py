"""Walking under a joystick: zero moment point, support polygon, a walking reference, and a haptic signal of margin."""
