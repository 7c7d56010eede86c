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

"""A small checker of JSON Schema, for what docs/replay.schema.json uses.

It is stricter than the schema: a key that the schema does not name is an error. Programs that read the output
must pass over keys of later versions, but here nothing may come out that is not described.
"""

from collections.abc import Iterator
from typing import Any

KINDS = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "null": type(None),
    "integer": int,
    "number": (int, float),
}
KEYWORDS = {
    "$schema", "title", "description", "$defs", "$ref", "anyOf", "type", "enum", "const", "minimum", "items",
    "properties", "required", "additionalProperties",
}  # fmt: skip


class Checker:
    """Compares values with a schema, and remembers which of its properties it has met.

    Args:
        schema: The schema.
    """

    def __init__(self, schema: dict[str, Any]) -> None:
        self.schema = schema
        self.met: set[tuple[int, str]] = set()

    def errors(self, value: Any, schema: dict[str, Any] | None = None, path: str = "$") -> list[str]:
        """Return what is wrong with a value, a sentence each."""
        schema = self.schema if schema is None else schema
        assert set(schema) <= KEYWORDS, f"the checker does not know {set(schema) - KEYWORDS}"
        found = list(self._of_value(value, schema, path))
        if "$ref" in schema:
            found += self.errors(value, self.definition(schema["$ref"]), path)
        if "anyOf" in schema:
            tried = [self.errors(value, each, path) for each in schema["anyOf"]]
            found += [] if not all(tried) else min(tried, key=len)
        if isinstance(value, list) and "items" in schema:
            for number, each in enumerate(value):
                found += self.errors(each, schema["items"], f"{path}[{number}]")
        if isinstance(value, dict) and ("properties" in schema or "additionalProperties" in schema):
            found += self._of_object(value, schema, path)
        return found

    def definition(self, reference: str) -> dict[str, Any]:
        """Return what a reference within the schema leads to."""
        return self.schema["$defs"][reference.removeprefix("#/$defs/")]

    def _of_value(self, value: Any, schema: dict[str, Any], path: str) -> Iterator[str]:
        if "type" in schema:
            names = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
            is_number = isinstance(value, bool) and not {"boolean"} & set(names)
            if is_number or not any(isinstance(value, KINDS[name]) for name in names):
                yield f"{path}: {value!r} is no {' or '.join(names)}"
        if "enum" in schema and value not in schema["enum"]:
            yield f"{path}: {value!r} is none of {schema['enum']}"
        if "const" in schema and value != schema["const"]:
            yield f"{path}: {value!r} is not {schema['const']!r}"
        if "minimum" in schema and isinstance(value, int | float) and value < schema["minimum"]:
            yield f"{path}: {value!r} is below {schema['minimum']}"

    def _of_object(self, value: dict[str, Any], schema: dict[str, Any], path: str) -> Iterator[str]:
        properties, others = schema.get("properties", {}), schema.get("additionalProperties")
        yield from (f"{path} has no {name}" for name in schema.get("required", ()) if name not in value)
        for name, each in value.items():
            if name in properties:
                self.met.add((id(properties), name))
                yield from self.errors(each, properties[name], f"{path}.{name}")
            elif others is None:
                yield f"{path}: {name} is not described"
            else:
                yield from self.errors(each, others, f"{path}.{name}")

    def unmet(self, schema: Any = None) -> list[str]:
        """Return the properties that no value has had."""
        schema = self.schema if schema is None else schema
        if isinstance(schema, list):
            return [name for each in schema for name in self.unmet(each)]
        if not isinstance(schema, dict):
            return []
        properties = schema.get("properties", {})
        own = [name for name in properties if (id(properties), name) not in self.met]
        return own + [name for key, each in schema.items() if key != "required" for name in self.unmet(each)]
