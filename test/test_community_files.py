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

"""What those who carry it on are given: workflow, issue templates, citation."""

import re
from pathlib import Path

import yaml

import stereo_selfcal

ROOT = Path(__file__).resolve().parent.parent
GITHUB = ROOT / ".github"


def load(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_workflow_runs_what_any_machine_runs():
    workflow = load(GITHUB / "workflows" / "ci.yml")
    steps = [step.get("run", "") for job in workflow["jobs"].values() for step in job["steps"]]
    assert ".ci/run" in steps and (ROOT / ".ci" / "run").stat().st_mode & 0o111
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert {step.split()[1] for step in steps if step.startswith("make ")} <= set(targets)


def test_the_workflow_installs_as_the_page_says():
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    workflow = (GITHUB / "workflows" / "ci.yml").read_text(encoding="utf-8")
    for line in (
        "rosdep install --from-paths src --ignore-src",
        "colcon build --packages-select stereo_selfcal",
        "pip install --break-system-packages rosbags",
    ):
        assert line in page and line in workflow


def test_issues_ask_for_the_report_and_the_version():
    forms = [load(path) for path in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config"]
    assert len(forms) == 2
    for form in forms:
        fields = {part["id"]: part for part in form["body"] if "id" in part}
        assert "report" in fields and "--version" in fields["version"]["attributes"]["description"]
        assert "--report out.html" in str(form)
        assert all(part["attributes"]["label"] for part in fields.values())


def test_the_citation_is_of_this_version():
    citation = load(ROOT / "CITATION.cff")
    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == stereo_selfcal.__version__
    changelog = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    assert f"{citation['version']} ({citation['date-released']})" in changelog
