"""One axis of a haptic device, its drive, its sampled form, and the devices of the sources."""
