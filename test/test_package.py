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

ROOT = Path(__file__).resolve().parent.parent
NAME = "stereo_selfcal"
PROGRAMS = ("node", "replay", "fleet", "synth", "limits", "demo")


@pytest.fixture(scope="module")
def manifest() -> ElementTree.Element:
    return ElementTree.parse(ROOT / "package.xml").getroot()


@pytest.fixture
def setup_arguments(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run setup.py as colcon does, in its folder, and return what it tells setuptools."""
    pytest.importorskip("setuptools")
    monkeypatch.chdir(ROOT)
    with mock.patch("setuptools.setup") as setup:
        runpy.run_path("setup.py")
    return setup.call_args.kwargs


def test_manifest_is_an_ament_python_package(manifest):
    assert manifest.tag == "package"
    assert manifest.get("format") == "3"
    assert manifest.findtext("name") == NAME
    assert manifest.findtext("license") == "Apache-2.0"
    assert manifest.findtext("export/build_type") == "ament_python"
    assert "@" in manifest.find("maintainer").get("email")


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
    for folder in ("config", "launch", "bags/straight_road"):
        files = {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).iterdir() if path.is_file()}
        assert files, f"{folder}/ is empty"
        assert set(installed[f"share/{NAME}/{folder}"]) == files


def test_programs_go_where_ros2_run_looks(setup_arguments):
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg", encoding="utf-8")
    assert config["develop"]["script_dir"] == f"$base/lib/{NAME}"
    assert config["install"]["install_scripts"] == f"$base/lib/{NAME}"
    programs = [line.split(" = ")[0] for line in setup_arguments["entry_points"]["console_scripts"]]
    assert sorted(programs) == sorted(PROGRAMS)


@pytest.mark.parametrize("program", PROGRAMS)
def test_program_can_be_imported(program, setup_arguments):
    scripts = dict(line.split(" = ") for line in setup_arguments["entry_points"]["console_scripts"])
    module, function = scripts[program].split(":")
    if module.startswith(f"{NAME}.ros"):
        pytest.importorskip("rclpy")
    assert callable(getattr(importlib.import_module(module), function))
