"""What fails because ROS was shut down meanwhile is no error: it ends without a word."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.context import Context


@contextmanager
def silent_after_shutdown(context: Context) -> Iterator[None]:
    """Drop an error of what is done in a ``with`` statement if the context was shut down.

    A signal shuts the context down at any moment, from when on rcl refuses everything: to publish, to
    subscribe, to count publishers. Callbacks and threads that run at that moment come to know it by an error.

    Args:
        context: The context of the node.
    """
    try:
        yield
    except Exception:
        if context.ok():
            raise
