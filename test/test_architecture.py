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

"""Who may import whom: the estimator stays free of ROS, and the renderer free of the estimator's geometry."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "stereo_selfcal"

MAX_LINES = 400

CORE_THIRD_PARTY = {"cv2", "numpy"}

# The renderer shares the values that describe a scene with the estimator, and none of its derivations.
SYNTH_MAY_USE = ("stereo_selfcal.synth.", "stereo_selfcal.core.errors.", "stereo_selfcal.core.camera.rig.")
SYNTH_MAY_USE_EXACTLY = {"stereo_selfcal.core.geometry.pose.Extrinsics"}

# The rooms of core, each of which imports from those before it only. Modules of core itself are rooms of one:
# the floor that all stand on, and the roof that stands on all.
FLOOR = ("errors", "types", "config", "tolerances", "rejection", "reservations", "faults")
ROOMS = (
    *FLOOR,
    "numerics",
    "camera",
    "geometry",
    "road",
    "alignment_verdict",
    "delay_report",
    "lanes",
    "estimators",
    "evidence",
    "search",
    "results",
    "drive",
    "calibrator",
    "road_now",
    "analysis",
)

WITHOUT_ROS = (
    "stereo_selfcal",
    "stereo_selfcal.__main__",
    "stereo_selfcal.cli.replay",
    "stereo_selfcal.cli.synth",
    "stereo_selfcal.cli.limits",
    "stereo_selfcal.cli.fleet",
    "stereo_selfcal.offline",
)

# What only `fleet` needs; it says what is missing, and a vehicle does without. In setup.py as extras.
OPTIONAL = {"dask", "distributed", "pyarrow"}

# What the node does without: recordings are read and written with rosbags, which comes by pip alone. With it
# comes what it unpacks with; "compression" is of Python itself from 3.14 on. docs/install.md tells how.
RECORDINGS = {"rosbags", "apsw", "backports", "compression", "lz4", "ruamel"}

COMPUTED = "an import of a computed name"

# Import name -> rosdep key, where the two differ.
ROSDEP_KEYS = {
    "cv2": "python3-opencv",
    "jinja2": "python3-jinja2",
    "numpy": "python3-numpy",
    "tf2_ros": "tf2_ros_py",
    "yaml": "python3-yaml",
}


def sources(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


def imported_names(tree: ast.AST, package: str) -> Iterator[str]:
    """Yield the full dotted name of everything imported, inside functions too; `from a import b` gives `a.b`.

    Args:
        tree: A parsed module.
        package: The dotted name of the package the module is in, which relative imports start from.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - (node.level - 1)]
                origin = ".".join([*parents, origin] if origin else parents)
            yield from (f"{origin}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and called_name(node) in {"import_module", "__import__"}:
            argument = node.args[0] if node.args else None
            yield argument.value if isinstance(argument, ast.Constant) else COMPUTED


def called_name(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def imports_of(path: Path) -> set[str]:
    package = ".".join(path.relative_to(ROOT).parent.parts)
    return set(imported_names(ast.parse(path.read_text(encoding="utf-8")), package))


def third_party(names: set[str]) -> set[str]:
    tops = {name.split(".")[0] for name in names}
    return tops - set(sys.stdlib_module_names) - {PACKAGE.name}


def is_ros(module: str) -> bool:
    return module in {"ament_index_python", "launch", "launch_ros", "rclpy"} or module.endswith(
        ("_interfaces", "_msgs", "_srvs")
    )


def test_imports_are_found_in_every_form():
    source = """
import os.path
from numpy import linalg
from . import sibling
from .sibling import thing
from ..cousin import other
def late():
    import rclpy.node
    importlib.import_module("sensor_msgs.msg")
    importlib.import_module(name)
"""
    assert set(imported_names(ast.parse(source), "pkg.core")) == {
        "os.path",
        "numpy.linalg",
        "pkg.core.sibling",
        "pkg.core.sibling.thing",
        "pkg.cousin.other",
        "rclpy.node",
        "sensor_msgs.msg",
        COMPUTED,
    }


@pytest.mark.parametrize("path", sources(PACKAGE / "core"), ids=lambda path: path.name)
def test_core_imports_numpy_opencv_and_itself_only(path: Path):
    names = imports_of(path)
    assert third_party(names) <= CORE_THIRD_PARTY
    ours = {name for name in names if name.split(".")[0] == PACKAGE.name}
    assert all(name.startswith("stereo_selfcal.core.") for name in ours), ours


def room_of(module: str) -> str:
    """Return the room of a module or name of core: `stereo_selfcal.core.lanes.hough` is in `lanes`."""
    return module.split(".")[2]


def test_every_module_of_core_is_in_a_room():
    found = {path.name.removesuffix(".py") for path in (PACKAGE / "core").iterdir()} - {"__pycache__"}
    assert found == {*ROOMS, "__init__"}


@pytest.mark.parametrize("path", sources(PACKAGE / "core"), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_rooms_of_core_import_from_those_before_them(path: Path):
    own = path.relative_to(PACKAGE / "core").parts[0].removesuffix(".py")
    used = {room_of(name) for name in imports_of(path) if name.startswith("stereo_selfcal.core.")} - {own}
    allowed = ROOMS[: ROOMS.index(own)] if own in ROOMS else ()
    assert used <= set(allowed), f"{own} imports from {sorted(used - set(allowed))}"


def test_no_module_imports_a_private_name_of_another():
    for path in sources(PACKAGE):
        private = {name for name in imports_of(path) if name.split(".")[-1].startswith("_")}
        private -= {name for name in private if name.endswith(("__version__", "__future__"))}
        assert not {name for name in private if name.startswith(PACKAGE.name)}, path


def test_renderer_shares_no_geometry_with_the_estimator():
    for path in sources(PACKAGE / "synth"):
        ours = {name for name in imports_of(path) if name.split(".")[0] == PACKAGE.name}
        strangers = {name for name in ours if not name.startswith(SYNTH_MAY_USE)} - SYNTH_MAY_USE_EXACTLY
        assert not strangers, f"{path.relative_to(ROOT)} imports {sorted(strangers)}"


def test_no_two_classes_have_one_name():
    """Private classes count as well: who reads `_Segment` must not have to ask which one."""
    definitions: dict[str, list[str]] = {}
    for path in sources(PACKAGE):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                definitions.setdefault(node.name.lstrip("_"), []).append(
                    f"{path.relative_to(ROOT)}:{node.lineno}"
                )
    shared = {name: where for name, where in definitions.items() if len(where) > 1}
    assert len(definitions) > 100
    assert not shared, "rename the less public one"


def test_type_aliases_of_one_name_mean_one_type():
    """The renderer may not import core's aliases; what it calls by their names is the same."""
    meanings: dict[str, set[str]] = {}
    for path in sources(PACKAGE):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript):
                names = [target.id for target in node.targets if isinstance(target, ast.Name)]
                for name in names:
                    if name.lstrip("_")[0].isupper() and not name.isupper():
                        meanings.setdefault(name.lstrip("_"), set()).add(ast.unparse(node.value))
    assert {"Array", "Image", "Side"} <= set(meanings)
    assert not {name: found for name, found in meanings.items() if len(found) > 1}


@pytest.mark.parametrize("path", sources(PACKAGE), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_only_the_ros_folder_imports_ros(path: Path):
    if path.parent != PACKAGE / "ros":
        assert not {name for name in third_party(imports_of(path)) if is_ros(name)}


def test_folders_import_what_the_page_on_the_architecture_says():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    told = {
        cells[0].strip("` "): set(re.findall(r"`(\w+)`", cells[2]))
        for cells in (line.strip("|").split("|") for line in page.splitlines() if line.startswith("| `"))
        if (PACKAGE / cells[0].strip("` ")).is_dir()
    }
    folders = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    assert told.keys() == folders
    for folder in folders:
        names = set().union(*(imports_of(path) for path in sources(PACKAGE / folder)))
        used = {name.split(".")[1] for name in names if name.startswith(f"{PACKAGE.name}.")}
        assert (used & folders) - {folder} <= told[folder], folder


@pytest.mark.parametrize("module", WITHOUT_ROS)
def test_import_without_ros(module: str):
    code = f"import {module}, sys; print(*sorted(name for name in sys.modules if '.' not in name))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    loaded = set(run.stdout.split())
    assert PACKAGE.name in loaded
    assert not {name for name in loaded if is_ros(name)}


@pytest.mark.ros
def test_the_node_imports_nothing_that_reads_recordings():
    code = "import stereo_selfcal.ros.node, sys; print(*{name.partition('.')[0] for name in sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "rclpy" in run.stdout.split()
    assert RECORDINGS.isdisjoint(run.stdout.split())


@pytest.mark.parametrize("path", sources(PACKAGE), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_file_is_short_enough_to_read(path: Path):
    text = path.read_text(encoding="utf-8")
    lines = len(text[text.index("\n\n") :].splitlines())  # the licence above it is not read
    assert lines <= MAX_LINES, f"{lines} lines: split it"


def test_only_the_command_line_prints():
    for path in sources(PACKAGE):
        if "cli" in path.parts or path.name == "__main__.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            called = isinstance(node, ast.Call) and called_name(node)
            assert called != "print", f"{path.relative_to(ROOT)}:{node.lineno} prints; log it or return it"


def test_package_xml_declares_what_is_imported_and_nothing_else():
    paths = [*sources(PACKAGE), *sources(ROOT / "launch")]
    imported = third_party(set().union(*(imports_of(path) for path in paths)) - {COMPUTED})
    imported -= OPTIONAL | RECORDINGS
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    declared = {element.text for element in manifest.iter("exec_depend")}
    assert declared == {ROSDEP_KEYS.get(name, name) for name in imported}
