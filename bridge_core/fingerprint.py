# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which parameters of a machine decide, as one hash; and what differs from those of before."""

from __future__ import annotations

from collections.abc import Mapping
import hashlib
from importlib import metadata
import json
from typing import Any

from bridge_core.parameters import is_ros_parameter

Nodes = Mapping[str, Mapping[str, Any]]  # full name of a node: its parameters, defaults included

# What a node is called, says and shows; whatever else there is decides.
_BESIDE = frozenset(('autostart', 'frame_id', 'hardware_id', 'publish_raw', 'status_rate'))
_REMEMBERS = 'commissioning.'


def version() -> str:
    """Return this package's version."""
    try:
        return metadata.version('rugged_teleop')
    except metadata.PackageNotFoundError:  # sources that nobody has installed
        return 'unknown'


def deciding(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a node that decide."""
    return {
        name: value
        for name, value in values.items()
        if not (name in _BESIDE or name.startswith(_REMEMBERS) or is_ros_parameter(name))
    }


def fingerprint(nodes: Nodes) -> str:
    """Return a SHA-256 of what decides, in which no order counts, and no comment of the file."""
    values = {name: deciding(values) for name, values in nodes.items()}
    text = json.dumps(values, sort_keys=True, default=list)
    return hashlib.sha256(text.encode()).hexdigest()


def differences(before: Nodes, now: Nodes) -> list[str]:
    """Return what differs, such as 'joint.left.max was 10.0, is 12.0', node by node."""
    found = []
    for node in sorted({*before, *now}):
        if node not in now or node not in before:
            found.append(f'{node} {"is new" if node in now else "is gone"}')
            continue
        was, value = deciding(before[node]), deciding(now[node])
        found += [
            f'{name} was {_shown(was, name)}, is {_shown(value, name)}'
            for name in sorted({*was, *value})
            if _shown(was, name) != _shown(value, name)
        ]
    return found


def _shown(values: Mapping[str, Any], name: str) -> Any:
    return values.get(name, 'not there')
