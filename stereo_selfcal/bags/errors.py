"""The exceptions of this package."""

from ..core.errors import SelfcalError, printable


class BagError(SelfcalError):
    """A recording cannot be used: missing, damaged, or without a stereo pair.

    Args:
        message: One sentence. Names in it may come from the recording: what cannot be printed is escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class NoFileError(BagError):
    """Something else is where a file is needed: a folder, a pipe, a device."""


class TooLargeError(BagError):
    """A recording states a size that no recording of cameras has, so that it is not read further."""
