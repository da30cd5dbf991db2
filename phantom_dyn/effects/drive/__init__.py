"""Effects of drives: delay, lag, limit, ripple, cogging and others; one module for each effect."""
