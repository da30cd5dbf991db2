"""A law for what the catalogue does not explain: the inputs that the residual depends on, and its shortest formula."""
