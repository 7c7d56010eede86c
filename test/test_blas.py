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

"""Programs of this package take one thread of BLAS, and leave those of others alone."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from stereo_selfcal.blas import one_thread

ROOT = Path(__file__).resolve().parent.parent


def test_a_number_of_the_user_stays():
    environment = {}
    one_thread(environment)
    assert environment == {"OPENBLAS_NUM_THREADS": "1"}
    environment["OPENBLAS_NUM_THREADS"] = "3"
    one_thread(environment)
    assert environment == {"OPENBLAS_NUM_THREADS": "3"}


@pytest.mark.parametrize(
    ("module", "expected"), [("stereo_selfcal", "None False"), ("stereo_selfcal.cli", "1 False")]
)
def test_it_is_set_before_numpy_is_imported(module, expected):
    code = f"import {module}, os, sys; print(os.environ.get('OPENBLAS_NUM_THREADS'), 'numpy' in sys.modules)"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == expected


def test_the_names_of_the_package_are_there():
    code = (
        "from stereo_selfcal import *; import stereo_selfcal as s; print(all(n in dir(s) for n in s.__all__))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
