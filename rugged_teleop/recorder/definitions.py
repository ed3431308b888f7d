# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The definition of a message type with all that is in it, as MCAP's schemas have it."""

from __future__ import annotations

from collections.abc import Iterator
import importlib
from pathlib import Path
import re
from typing import Any

_SEPARATOR = '=' * 80
_NESTED = re.compile(r'(\w+)/(\w+)')


def message_class(kind: str) -> Any:
    """Return the class of ``std_msgs/msg/Bool``. :raises LookupError: it is not installed."""
    package, _, name = kind.split('/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise LookupError(f'{kind} is not installed') from error


def definition_of(kind: str) -> str:
    """
    Return the text of a type, and behind it that of every type in it, each once.

    :raises LookupError: one of them is not installed, or without its text.
    """
    first, *others = dict.fromkeys(_with_nested(kind))
    parts = [_text_of(first)]
    for each in others:
        package, _, name = each.split('/')
        parts.append(f'MSG: {package}/{name}\n{_text_of(each)}')
    return f'{_SEPARATOR}\n'.join(parts)


def _with_nested(kind: str) -> Iterator[str]:
    yield kind
    for field in message_class(kind).get_fields_and_field_types().values():
        nested = _NESTED.search(field)
        if nested is not None:
            yield from _with_nested(f'{nested[1]}/msg/{nested[2]}')


def _text_of(kind: str) -> str:
    """Return what stands in share/, beside or above the package of the class."""
    package, _, name = kind.split('/')
    module = Path(importlib.import_module(package).__file__ or '')
    for folder in module.parents:
        path = folder / 'share' / package / 'msg' / f'{name}.msg'
        if path.is_file():
            return path.read_text(encoding='utf-8').rstrip() + '\n'
    raise LookupError(f'{kind} has no definition in share/')
