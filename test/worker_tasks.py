"""What workers are made to do instead of their work; they import it by this name."""

import os


def die(frame):
    os._exit(1)


def fail(frame):
    raise ZeroDivisionError("a bug")
