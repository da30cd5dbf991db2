"""What a sampled device can render before it becomes unstable."""
