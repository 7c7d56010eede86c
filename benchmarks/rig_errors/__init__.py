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

"""Right cameras that have turned: measured and told, or refused, and never believed (issue 20).

It was written from the interface and the renderers, without a look at how the estimator works. The parts are
turns of the right camera on recorded and rendered roads (:mod:`.turns`), rigs and paint drawn from the stated
priors (:mod:`.priors`), rows that are off, the change over a drive and the worlds of others (:mod:`.others`),
and drives whose right images are late (:mod:`.late`).
"""

from __future__ import annotations

from collections.abc import Iterator

from ..options import Options
from ..table import Table
from .late import late_tables
from .others import drive_tables, row_tables, world_tables
from .priors import prior_tables
from .turns import turn_tables

PARTS = {
    "turns": turn_tables,
    "priors": prior_tables,
    "rows": row_tables,
    "change": drive_tables,
    "worlds": world_tables,
    "late": late_tables,
}


def rig_error_tables(options: Options) -> Iterator[Table]:
    """Measure the chosen parts, all of them by default."""
    for part in options.rig_parts or PARTS:
        yield from PARTS[part](options)
