"""Effects of transmissions, and of springs between motor, link and base; one module for each effect."""
