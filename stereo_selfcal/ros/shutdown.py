# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
