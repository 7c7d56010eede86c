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

"""YAML and JSON from outside, read without trust: bounded in size, without aliases, each key once."""

from __future__ import annotations

import json
import re
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ..core.errors import ConfigError, one_line, printable, shortened

_GREATEST_INTEGER = 2**63  # an integer parameter of ROS has 64 bits
_MERGE = "tag:yaml.org,2002:merge"
_FLOAT = "tag:yaml.org,2002:float"
# Numbers of YAML 1.2, of JSON and of rcl, which PyYAML takes for words: 1e3, 1.5e-05.
_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+\Z")


class UnreadableFileError(ConfigError):
    """A file cannot be read at all, so nothing is known of what is in it."""


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Loader that refuses what rcl does not know either.

    A few lines of aliases can stand for gigabytes, Python refuses to print an integer of 5 000 digits, and
    of two values of one key PyYAML keeps the last without a word.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise _problem("aliases (*name) are not allowed", self.peek_event())
        return super().compose_node(parent, index)

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if key.tag == _MERGE:
                raise _problem("merge keys (<<) are not allowed", key)
            if isinstance(key.value, str):
                if key.value in seen:
                    raise _problem(f"{shortened(key.value)} is there twice: each name once", key)
                seen.add(key.value)
        return node

    def construct_yaml_int(self, node: Any) -> int:
        value = int(super().construct_yaml_int(node))
        if not -_GREATEST_INTEGER <= value < _GREATEST_INTEGER:
            raise _problem("a whole number has more than 64 bits", node)
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)
_Loader.add_implicit_resolver(_FLOAT, _EXPONENT, list("-+.0123456789"))


def _problem(what: str, place: Any) -> yaml.MarkedYAMLError:
    return yaml.composer.ComposerError(None, None, what, place.start_mark)


def read_content(path: Path | str, most_bytes: int, what: str) -> bytes:
    """Return the bytes of a file.

    Args:
        path: The file.
        most_bytes: A larger file is refused unread.
        what: What it should be, for the error: "parameter file".

    Raises:
        UnreadableFileError: The file cannot be read.
        ConfigError: It is too large.
    """
    shown = printable(str(path))
    try:
        if (
            not stat.S_ISREG(Path(path).stat().st_mode) and not Path(path).is_dir()
        ):  # a pipe would be waited for
            raise UnreadableFileError(f"{shown} cannot be read: it is not a file; give the name of a {what}")
        with Path(path).open("rb") as file:
            content = file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        if isinstance(error, ConfigError):
            raise
        detail = getattr(error, "strerror", None) or str(error)
        raise UnreadableFileError(f"{shown} cannot be read: {detail.lower()}") from error
    if len(content) > most_bytes:
        raise ConfigError(
            f"{shown} is no {what}: it is larger than {most_bytes} bytes, which is the most allowed"
        )
    return content


def read_text(path: Path | str, most_bytes: int, what: str) -> str:
    """Return the text of a file; arguments and errors are those of :func:`read_content`.

    Raises:
        ConfigError: It is no text.
    """
    try:
        return read_content(path, most_bytes, what).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{printable(str(path))} cannot be read: it is not a text file") from error


def parse_yaml(path: Path | str, text: str) -> Any:
    """Return the one document in a text.

    Args:
        path: Where the text is from, for the error.
        text: YAML.

    Raises:
        ConfigError: It cannot be read, or has what could be read in two ways.
    """
    shown = printable(str(path))
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        if getattr(error, "context", None) == "expected a single document in the stream":
            raise ConfigError(f"{shown} has a second document{where} (---): leave one of them") from error
        problem = getattr(error, "problem", None)
        detail = printable(problem) if problem else one_line(error)
        raise ConfigError(f"{shown} is not YAML{where}: {detail}") from error
    except Exception as error:
        raise ConfigError(f"{shown} is not YAML that can be read: {_named(error)}") from error


def parse_json(path: Path | str, text: str) -> Any:
    """Return the document in a text, which is JSON; the same as :func:`parse_yaml` for YAML."""
    shown = printable(str(path))
    try:
        return json.loads(text, object_pairs_hook=_each_once)
    except json.JSONDecodeError as error:
        raise ConfigError(f"{shown} is not JSON in line {error.lineno}: {error.msg.lower()}") from error
    except ConfigError as error:
        raise ConfigError(f"{shown} is not JSON: {error}") from error
    except Exception as error:
        raise ConfigError(f"{shown} is not JSON that can be read: {_named(error)}") from error


def _each_once(pairs: list[tuple[str, Any]]) -> Mapping[str, Any]:
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise ConfigError(f"{shortened(name)} is there twice: each name once")
        values[name] = value
    return values


def _named(error: Exception) -> str:
    return printable(" ".join(f"{type(error).__name__}: {error}".split()))
