# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session needs to know: defaults and checks come from the table of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar

from bridge_core.parameters import Parameter


class CheckedSettings:
    """
    The base of each session's Settings, a frozen dataclass.

    A field named after a parameter of the same type takes its default from ``TABLE`` and is
    checked by it.
    """

    TABLE: ClassVar[Mapping[str, Parameter]] = {}

    def __post_init__(self) -> None:
        """:raises ParameterError: for a value that its parameter does not allow."""
        for name, parameter in self._of_parameters().items():
            parameter.validate(getattr(self, name))

    @classmethod
    def named(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fields that are parameters of the same name and type, from the values."""
        return {name: values[name] for name in cls._of_parameters()}

    @classmethod
    def _of_parameters(cls) -> dict[str, Parameter]:
        names = [each.name for each in fields(cls)]  # type: ignore[arg-type]
        return {
            name: cls.TABLE[name]
            for name in names
            if name in cls.TABLE and not isinstance(cls.TABLE[name].default, list)
        }


def table_of(parameters: tuple[Parameter, ...]) -> dict[str, Parameter]:
    """Return parameters by name."""
    return {parameter.name: parameter for parameter in parameters}
