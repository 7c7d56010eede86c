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

"""Which version of the package is measured."""

from __future__ import annotations

import subprocess
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]


def estimator_revision() -> str:
    """Return the last commit that changed the package itself; "-changed" where files differ from it."""
    try:
        revision = _git("log", "-1", "--format=%h", "--", "stereo_selfcal")
        changes = _git("diff", "--stat", "HEAD", "--", "stereo_selfcal")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{revision}-changed" if changes else revision


def _git(*arguments: str) -> str:
    run = subprocess.run(["git", *arguments], cwd=_ROOT, capture_output=True, text=True, check=True)
    return run.stdout.strip()
