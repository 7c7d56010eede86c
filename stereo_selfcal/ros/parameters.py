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

"""Parameters of the node: declared from one table and checked together; results are set atomically."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ..core.errors import ConfigError, OutputError, shortened
from ..core.geometry.pose import POSE_COMPONENTS
from ..files.node_settings import ALIGNMENT_PREFIX, RESULT_PREFIX, NodeSetting, default_output_path
from .config import SETTINGS, NodeConfig
from .store import check_output

_OUTPUT = "output_path"
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_RESULT_DESCRIPTION = {
    **{each.name: f"{each.description} [{each.si_unit}]" for each in POSE_COMPONENTS},
    **{each.std_name: f"Standard deviation of the {each.label} [{each.si_unit}]" for each in POSE_COMPONENTS},
}
_ALIGNMENT_DESCRIPTION = {
    "pitch_rad": "Pitch of the right camera against where the rig has it, > 0: nose down [rad]",
    "roll_rad": "Roll of the right camera against where the rig has it, > 0: right side down [rad]",
    "yaw_rad": "Yaw of the right camera against where the rig has it, > 0: too far left [rad]",
    "pitch_std_rad": "Standard deviation of the right camera's pitch [rad]",
    "roll_std_rad": "Standard deviation of the right camera's roll [rad]",
    "yaw_std_rad": "Standard deviation of the right camera's yaw [rad]",
}
_YAW_DESCRIPTION = {
    "yaw_rad": "Yaw of the camera against the direction of travel, > 0: it points left of it [rad]",
    "yaw_std_rad": "Standard deviation of the yaw [rad]",
}
# All result parameters with their descriptions; each is unset while it is not known.
_RESULTS = {RESULT_PREFIX + name: text for name, text in (_RESULT_DESCRIPTION | _YAW_DESCRIPTION).items()} | {
    ALIGNMENT_PREFIX + name: text for name, text in _ALIGNMENT_DESCRIPTION.items()
}


class NodeParameters:
    """Declares the parameters on a node, checks changes, and sets the results.

    Args:
        node: The node.
        on_change: Called with the new configuration after a parameter was set.

    Raises:
        ConfigError: A value given at the start has the wrong type or is out of range.
    """

    def __init__(self, node: Node, on_change: Callable[[NodeConfig], None]) -> None:
        self._node = node
        self._on_change = on_change
        self._publishing = False
        self._default_output = default_output_path(node.get_fully_qualified_name())
        for setting in SETTINGS.values():
            _declare(node, self._with_default(setting))
        self._declare_result(_RESULTS)
        self._config = NodeConfig.from_values(self._values())
        self._check_output_at_start()
        node.add_pre_set_parameters_callback(lambda given: [_of_its_type(parameter) for parameter in given])
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._changed)

    @property
    def config(self) -> NodeConfig:
        """The present values of the parameters."""
        return self._config

    @property
    def output_is_default(self) -> bool:
        """Whether the result goes to the file that is this node's own by default."""
        return bool(self._node.get_parameter(_OUTPUT).value == self._default_output)

    def publish_result(self, parameters: Mapping[str, float]) -> None:
        """Set the result parameters atomically; those that are not given lose their values.

        To be called from the node's default callback group. The parameter services run there, too, so nobody
        reads half a result.
        """
        values = [Parameter(name, Parameter.Type.DOUBLE, value) for name, value in parameters.items()]
        outcome = self._set_results(values, [name for name in _RESULTS if name not in parameters])
        if not outcome.successful:
            raise ConfigError(f"the result parameters were not set: {outcome.reason}")

    def withdraw_result(self) -> None:
        """Remove the values of the result parameters; from the same callback group as above."""
        self._set_results([], list(_RESULTS))

    def _set_results(self, values: list[Parameter], unknown: Iterable[str]) -> SetParametersResult:
        """Set result parameters, and remove the values of others, all at once."""
        gone = [name for name in unknown if self._node.get_parameter(name).value is not None]
        unset = [Parameter(name, Parameter.Type.NOT_SET) for name in gone]
        self._publishing = True
        try:
            outcome = self._node.set_parameters_atomically([*values, *unset])
            if outcome.successful:  # rclpy undeclares what is set to nothing
                self._declare_result(gone)
        finally:
            self._publishing = False
        return outcome

    def _with_default(self, setting: NodeSetting) -> NodeSetting:
        return replace(setting, default=self._default_output) if setting.name == _OUTPUT else setting

    def _check_output_at_start(self) -> None:
        """Refuse an output_path that cannot be written; of the default one, which nobody chose, only warn."""
        path = self._config.output_path
        if path is None:
            return
        try:
            check_output(path)
        except OutputError as error:
            if not self.output_is_default:
                raise ConfigError(f"{_OUTPUT}: {error}") from error
            self._node.get_logger().warning(f"results will not be saved: {error}, or set {_OUTPUT}")

    def _declare_result(self, names: Iterable[str]) -> None:
        for name in names:
            # Dynamically typed: a typed parameter without a value could not be read at all. Not read-only:
            # the node itself could not set it then; _check refuses others. Overrides are ignored: a result
            # file among the node's parameter files is no result of this run.
            descriptor = ParameterDescriptor(
                description=f"Result: {_RESULTS[name]}; without value until it is known",
                dynamic_typing=True,
            )
            self._node.declare_parameter(name, None, descriptor, ignore_override=True)

    def _values(self) -> dict[str, Any]:
        return {name: self._node.get_parameter(name).value for name in SETTINGS}

    def _check(self, parameters: Iterable[Parameter]) -> SetParametersResult:
        values = self._values()
        for parameter in parameters:
            if parameter.name in _RESULTS and not self._publishing:
                reason = f"{parameter.name} is a result: it is set by ~/calibrate alone"
                return SetParametersResult(successful=False, reason=reason)
            if parameter.name in values:
                values[parameter.name] = parameter.value
        try:
            config = NodeConfig.from_values(values)
            if config.output_path is not None and config.output_path != self._config.output_path:
                check_output(config.output_path)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except OutputError as error:
            return SetParametersResult(successful=False, reason=f"{_OUTPUT}: {error}")
        return SetParametersResult(successful=True)

    def _changed(self, parameters: Iterable[Parameter]) -> None:
        if any(parameter.name in SETTINGS for parameter in parameters):
            self._config = NodeConfig.from_values(self._values())
            self._on_change(self._config)


def _descriptor(setting: NodeSetting) -> ParameterDescriptor:
    unit = f" [{setting.unit}]" if setting.unit else ""
    descriptor = ParameterDescriptor(description=setting.description + unit, read_only=setting.fixed)
    if setting.choices:
        descriptor.additional_constraints = f"one of: {', '.join(setting.choices)}"
    if setting.low is not None and setting.high is not None:
        if isinstance(setting.default, float):
            span = FloatingPointRange(from_value=float(setting.low), to_value=float(setting.high), step=0.0)
            descriptor.floating_point_range = [span]
        else:
            descriptor.integer_range = [
                IntegerRange(from_value=int(setting.low), to_value=int(setting.high), step=1)
            ]
    return descriptor


def _declare(node: Node, setting: NodeSetting) -> None:
    """Declare one parameter; what :func:`_as_its_type` says is taken for another."""
    try:
        node.declare_parameter(setting.name, setting.default, _descriptor(setting))
        return
    except (InvalidParameterTypeException, InvalidParameterValueException):
        value = _override(node, setting)
    value = _as_its_type(value, setting)
    if type(value) is not type(setting.default):
        kind = type(setting.default).__name__
        raise ConfigError(f"{setting.name} is {shortened(value)}: a value of type {kind} is needed")
    try:
        node.declare_parameter(setting.name, value, _descriptor(setting), ignore_override=True)
    except InvalidParameterValueException:
        raise ConfigError(
            f"{setting.name} is {shortened(value)}: it must lie in {setting.range_text}"
        ) from None


def _override(node: Node, setting: NodeSetting) -> Any:
    """Return the value given at the start for a parameter, whatever its type."""
    value = node.declare_parameter(setting.name, None, ParameterDescriptor(dynamic_typing=True)).value
    node.undeclare_parameter(setting.name)
    return value


def _of_its_type(parameter: Parameter) -> Parameter:
    """Return a parameter with the type it was declared with, where its value can be taken for one."""
    setting = SETTINGS.get(parameter.name)
    if setting is None or type(parameter.value) is type(setting.default):
        return parameter
    value = _as_its_type(parameter.value, setting)
    return parameter if value is parameter.value else Parameter(parameter.name, value=value)


def _as_its_type(value: Any, setting: NodeSetting) -> Any:
    """Return a value as the type of a setting, if that is what its writer meant; else as it is.

    That is a whole number where a float is needed (``timeout_s:=5``), true or false for a switch of 1 and 0,
    and a number that YAML 1.1 takes for a word, such as 1e-05: ``ros2 param load`` hands over what ``ros2
    param dump`` wrote in this way.
    """
    kind = type(setting.default)
    if kind is float and type(value) is int:
        return float(value)
    if kind is float and isinstance(value, str) and _NUMBER.fullmatch(value):
        return float(value)
    if setting.is_switch and isinstance(value, bool):
        return int(value)
    return value
