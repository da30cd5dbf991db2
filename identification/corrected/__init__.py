"""What a diagnosis found as files that simulators and other programs read."""
