"""Replays a recording in a browser: the measured motion next to the motions of the given and the corrected model."""
