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

"""One thread for linear algebra: the matrices of a frame are small.

OpenBLAS starts a thread per core, and those wait for each other by spinning. To decompose matrices of
64 x 64 this way takes three times the processor time of one thread, and more on busy cores.
"""

import os
from collections.abc import MutableMapping

_VARIABLE = "OPENBLAS_NUM_THREADS"


def one_thread(environment: MutableMapping[str, str] | None = None) -> None:
    """Ask OpenBLAS for one thread, unless the user asked for another number.

    OpenBLAS reads it when numpy is imported, so programs call this first.

    Args:
        environment: Variables of a process to be started, None for those of this one.
    """
    (os.environ if environment is None else environment).setdefault(_VARIABLE, "1")
