"""The exceptions of both packages."""


class PhantomDynError(Exception):
    """Anything that phantom-dyn refuses or cannot do; its text is one sentence for the user."""


class RobotError(PhantomDynError, ValueError):
    """A robot file, a name in it, or its configuration cannot be used."""


class LogError(PhantomDynError, ValueError):
    """A recording cannot be used: the text says file, column, row, value and what to do."""


class ParameterError(PhantomDynError, ValueError):
    """A parameter has the wrong length, is out of bounds or is not physically consistent."""


class ChainError(PhantomDynError, ValueError):
    """A closed chain cannot be closed, or is singular, where it was asked for: the text names loop and residual."""


class UsageError(PhantomDynError, ValueError):
    """The command line was called with something that it does not understand."""


class IdentifiabilityError(PhantomDynError):
    """The recording excites too little for what was asked."""


class EstimationError(PhantomDynError):
    """A solver failed."""
