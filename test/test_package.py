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

"""What colcon, rosdep and a release read: package.xml, setup.py, setup.cfg and the changelog agree."""

import configparser
import importlib
import re
import runpy
from pathlib import Path
from typing import Any
from unittest import mock
from xml.etree import ElementTree

import pytest

import stereo_selfcal
from stereo_selfcal.__main__ import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
NAME = "stereo_selfcal"
PROGRAMS = ("node", "replay", "fleet", "history", "synth", "limits", "demo")


@pytest.fixture(scope="module")
def manifest() -> ElementTree.Element:
    return ElementTree.parse(ROOT / "package.xml").getroot()


# What sets up: colcon (with --symlink-install), and pip.
COLCON, SYMLINKS, PIP = (
    ["egg_info", "build", "install", "--record", "install.log"],
    ["develop", "--editable"],
    ["bdist_wheel"],
)


def read_setup(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run setup.py in its folder, as others do, and return what it tells setuptools."""
    pytest.importorskip("setuptools")
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("sys.argv", ["setup.py", *arguments])
    with mock.patch("setuptools.setup") as setup:
        runpy.run_path("setup.py")
    return setup.call_args.kwargs


@pytest.fixture
def setup_arguments(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    return read_setup(COLCON, monkeypatch)


def programs_of(arguments: dict[str, Any]) -> dict[str, str]:
    return dict(line.split(" = ") for line in arguments["entry_points"]["console_scripts"])


def test_manifest_is_an_ament_python_package(manifest):
    assert manifest.tag == "package"
    assert manifest.get("format") == "3"
    assert manifest.findtext("name") == NAME
    assert manifest.findtext("license") == "Apache-2.0"
    assert manifest.findtext("export/build_type") == "ament_python"
    assert "@" in manifest.find("maintainer").get("email")


def test_every_key_is_in_the_table_of_the_page_on_installing(manifest):
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    keys = {element.text for element in manifest if element.tag.endswith("depend")}
    assert set(re.findall(r"^\| `([\w-]+)` \|", page, re.MULTILINE)) == keys
    # What only pip has is refused by rosdep on Ubuntu 24.04.
    assert not [key for key in keys if key.endswith("-pip")]


def test_urls_are_told(manifest):
    kinds = [url.get("type") for url in manifest.iter("url")]
    assert kinds == ["website", "repository", "bugtracker"]


def test_dependencies_are_named_once(manifest):
    keys = [element.text for element in manifest if element.tag.endswith("depend")]
    assert len(keys) == len(set(keys))


def test_versions_agree(manifest, setup_arguments):
    changelog = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    newest = re.search(r"^(\d+\.\d+\.\d+) \(\d{4}-\d{2}-\d{2}\)$", changelog, re.MULTILINE)
    assert newest, "CHANGELOG.rst has no heading of the form 1.2.3 (2026-01-31)"
    found = {manifest.findtext("version"), setup_arguments["version"], newest[1]}
    assert found == {stereo_selfcal.__version__}


def test_setup_repeats_the_manifest(manifest, setup_arguments):
    maintainer = manifest.find("maintainer")
    assert setup_arguments["name"] == NAME
    assert setup_arguments["license"] == manifest.findtext("license")
    assert setup_arguments["maintainer"] == maintainer.text
    assert setup_arguments["maintainer_email"] == maintainer.get("email")


def test_every_package_is_installed(setup_arguments):
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / NAME).rglob("*.py")}
    assert set(setup_arguments["packages"]) == {".".join(folder.parts) for folder in folders}


def test_every_data_file_is_installed(setup_arguments):
    installed = dict(setup_arguments["data_files"])
    assert installed["share/ament_index/resource_index/packages"] == [f"resource/{NAME}"]
    assert installed[f"share/{NAME}"] == ["package.xml"]
    for folder in ("config", "launch", "bags/drive", "bags/straight_road"):
        files = {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).iterdir() if path.is_file()}
        assert files, f"{folder}/ is empty"
        assert set(installed[f"share/{NAME}/{folder}"]) == files


@pytest.mark.parametrize("arguments", [COLCON, SYMLINKS])
def test_programs_go_where_ros2_run_looks(arguments, monkeypatch):
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg", encoding="utf-8")
    assert config["develop"]["script_dir"] == f"$base/lib/{NAME}"
    assert config["install"]["install_scripts"] == f"$base/lib/{NAME}"
    assert sorted(programs_of(read_setup(arguments, monkeypatch))) == sorted(PROGRAMS)
    assert set(PROGRAMS) == set(COMMANDS)


def test_pip_puts_one_program_into_bin(monkeypatch):
    assert list(programs_of(read_setup(PIP, monkeypatch))) == [NAME]


def test_pip_brings_the_least_versions_that_are_tested(setup_arguments):
    """But for what only ROS has, and to within the last digit: a vehicle's Ubuntu decides that one."""
    needed = dict(line.split(">=") for line in setup_arguments["install_requires"])
    floor = (ROOT / "requirements" / "floor.txt").read_text(encoding="utf-8").splitlines()
    tested = dict(line.split("==") for line in floor if "==" in line)
    assert needed.keys() == tested.keys()
    assert all(tested[name].startswith(version) for name, version in needed.items())


@pytest.mark.parametrize("program", [*PROGRAMS, NAME])
def test_program_can_be_imported(program, monkeypatch):
    scripts = programs_of(read_setup(PIP if program == NAME else COLCON, monkeypatch))
    module, function = scripts[program].split(":")
    assert callable(getattr(importlib.import_module(module), function))
