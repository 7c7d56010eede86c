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

"""What workers are made to do instead of their work; they import it by this name."""

import os
import time
from pathlib import Path

import numpy as np

PATIENCE_S = 30.0


def die(stretch):
    os._exit(1)


def fail(stretch):
    raise ZeroDivisionError("a bug")


class Faulty(np.ndarray):
    """An image in which a fault comes up as soon as it is looked at."""

    @property
    def size(self):
        raise ZeroDivisionError("a bug")


def meet(stretch):
    """Return the process that has this frame, once another process has one at the same time; else None.

    Frames are alone in their stretch, and have paths for names, all in one folder.
    """
    (frame,) = stretch
    name = Path(frame.name)
    name.with_suffix(f".{os.getpid()}").touch()
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if len({path.suffix for path in name.parent.iterdir()}) > 1:
            return [(os.getpid(), None)]
        time.sleep(0.01)
    return [(None, None)]


def start_slowly(*_):
    """Be a worker that takes minutes to start."""
    time.sleep(10 * PATIENCE_S)
