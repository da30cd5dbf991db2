"""One axis of a haptic device, its drive, its discretisation, and published devices."""
