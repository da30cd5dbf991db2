"""Walking with a joystick: zero moment point, support polygon, a walking reference and its margin as haptic signal."""
