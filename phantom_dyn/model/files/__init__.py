"""Files of robots and settings, read strictly: plain files, YAML without surprises, checked settings."""
