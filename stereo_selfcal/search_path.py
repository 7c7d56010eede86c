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

"""Where modules are looked for: not in the folder that happens to be the current one.

``python -m`` puts that folder first, and a folder of recordings from elsewhere may hold a ``yaml.py``.
"""

import os
import sys

# Variable that keeps the current folder off the path of `python -c`, by which worker processes are started;
# for Python 3.11 and later.
SAFE_PATH = "PYTHONSAFEPATH"
_PACKAGE = __name__.partition(".")[0]


def leave_current_folder() -> None:
    """Take the current folder off the path, if ``python -m`` of this package has put it there.

    The folder of the package itself goes to the end: worker processes find the package by it, and what is
    installed comes first.
    """
    words = sys.orig_argv
    ours = any(
        word.partition("-m")[2].partition(".")[0] == _PACKAGE  # -mNAME
        or (word.partition(".")[0] == _PACKAGE and words[index - 1].endswith("m"))  # -m NAME, -Im NAME
        for index, word in enumerate(words)
    )
    if not ours or sys.argv[:1] != ["-m"] or getattr(sys.flags, "safe_path", False) or not sys.path:
        return
    folder = sys.path.pop(0)
    home = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH120, PTH100 - pathlib is no builtin
    if folder not in ("", os.getcwd()):  # noqa: PTH109
        sys.path.insert(0, folder)
    elif home not in sys.path:
        sys.path.append(home)
