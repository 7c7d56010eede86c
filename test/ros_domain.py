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

"""A domain of DDS for this process alone, so that tests which run at the same time do not meet."""

import os

# Up to this one they collide with no port that Linux hands out to others.
HIGHEST = 101


def domain_of(environment, process, parent):
    """Return a domain, 1 ... HIGHEST.

    Args:
        environment: Variables of the process; pytest-xdist numbers its workers in them.
        process: Number of the process.
        parent: Number of the process that started it: of all workers of a run the same.
    """
    worker = environment.get("PYTEST_XDIST_WORKER")  # gw0, gw1, ...
    place = process if worker is None else parent + int(worker.removeprefix("gw"))
    return 1 + place % HIGHEST


def own_domain():
    return domain_of(os.environ, os.getpid(), os.getppid())
