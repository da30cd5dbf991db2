"""A law for what the catalogue does not explain: which inputs the rest depends on, and the shortest formula of it."""
