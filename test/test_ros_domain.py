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

"""Tests that run at the same time do not meet over DDS."""

import pytest
from ros_domain import HIGHEST, domain_of


@pytest.mark.parametrize("run", [4, HIGHEST - 1, 4_194_303])
def test_every_worker_of_a_run_has_a_domain_of_its_own(run):
    workers = [f"gw{number}" for number in range(64)]
    domains = {domain_of({"PYTEST_XDIST_WORKER": name}, 9999, run) for name in workers}
    assert len(domains) == len(workers)
    assert min(domains) >= 1 and max(domains) <= HIGHEST


def test_without_workers_it_goes_by_the_process():
    assert domain_of({}, 1000, 7) != domain_of({}, 1001, 7)
