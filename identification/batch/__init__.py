"""Many recordings, each diagnosed by itself."""
