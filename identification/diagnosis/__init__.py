"""The diagnosis of the gap between a robot and its model."""
