# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages of the bridges' protocols as plain values: what JSON has, and text for people."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from enum import Enum, Flag
from functools import partial, singledispatch
from typing import Any

from bridge_core.framing import Unknown
from rugged_teleop.devices import plain_values


@singledispatch
def plain(value: Any) -> Any:
    """
    Return a value as JSON has it.

    Messages are objects, bytes are hex, flags are a list of the names that are set. What a device
    does not vouch for is the word for that, such as 'error', in place of a number.
    """
    if dataclasses.is_dataclass(value):
        fields = (field.name for field in dataclasses.fields(value))
        return {name: _field(value, name) for name in fields}
    return value


def _field(message: Any, name: str) -> Any:
    value = plain(getattr(message, name))
    names = plain_values().names.get((type(message), name))
    return value if names is None else dict(zip(names, value, strict=False))


@plain.register
def _(value: Enum) -> str:
    return value.name.lower()


@plain.register
def _(value: Flag) -> list[str]:
    return [str(flag.name).lower() for flag in type(value) if value & flag]


@plain.register
def _(value: bytes) -> str:
    return value.hex()


@plain.register
def _(value: tuple) -> list[Any]:  # type: ignore[type-arg]  # what is registered is a class
    return [plain(item) for item in value]


@plain.register
def _(value: Unknown) -> dict[str, str]:
    return {'type': f'0x{value.kind:02X}'}


for _kind, _make in plain_values().values.items():
    plain.register(_kind, partial(_make, plain=plain))


def flat(value: Any, name: str = '') -> Iterator[tuple[str, Any]]:
    """Yield every single value with its path, such as 'axes.left_x'; lists count from 1."""
    if isinstance(value, dict):
        items = list(value.items())
    elif isinstance(value, list) and not _is_words(value):
        items = [(str(number), item) for number, item in enumerate(value, 1)]
    else:
        yield name, '+'.join(value) if isinstance(value, list) else value
        return
    for key, item in items:
        yield from flat(item, f'{name}.{key}' if name else key)


def _is_words(value: list[Any]) -> bool:
    return all(isinstance(item, str) for item in value)


def text(value: Any) -> str:
    """Return a value in short: of several that are true or false, those that are true."""
    if isinstance(value, dict):
        if value and all(isinstance(item, bool) for item in value.values()):
            return text([name for name, item in value.items() if item])
        return '{' + ' '.join(f'{name}={text(item)}' for name, item in value.items()) + '}'
    if isinstance(value, list):
        if _is_words(value):
            return '+'.join(value) or 'none'
        return '[' + ' '.join(map(text, value)) + ']'
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    return '-' if value in (None, '') else str(value)
