"""One axis of a haptic device, its drive, and what a sampling computer sees of it."""
