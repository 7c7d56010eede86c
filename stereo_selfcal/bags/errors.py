"""The exception of this package."""

from ..core.errors import SelfcalError


class BagError(SelfcalError):
    """A recording cannot be used: missing, damaged, or without a stereo pair. The message is one line."""
