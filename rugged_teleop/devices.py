# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The devices that are installed, as their packages say what they are."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
import importlib
from importlib import metadata
from typing import Any

from bridge_core.decoding import Decoder, Decoders, Plain
from bridge_core.device import Device, ENTRY_POINTS


@cache
def devices() -> dict[str, Device]:
    """Return them by the name of their node, in the order in which they start."""
    found = {each.value: each.load() for each in metadata.entry_points(group=ENTRY_POINTS)}
    in_order = sorted(found.values(), key=lambda each: (each.launch, each.name))
    return {each.name: each for each in in_order}


def loaded(place: str) -> Any:
    """Return what stands at a place, ``module:NAME``."""
    module, _, name = place.partition(':')
    return getattr(importlib.import_module(module), name)


@cache
def decoders() -> dict[str, Decoders]:
    """Return what reads captures of each device, by the name of its node."""
    return {name: loaded(device.decoders) for name, device in devices().items()}


def protocols(kind: type[Decoder] | None = None) -> Iterator[tuple[str, Any]]:
    """Yield node and decoder of each protocol, of one kind alone if it is given."""
    for node, each in decoders().items():
        yield from ((node, p) for p in each.protocols if kind is None or isinstance(p, kind))


@cache
def plain_values() -> Plain:
    """Return how the messages of all devices become plain values."""
    all_plain = [each.plain for each in decoders().values()]
    return Plain(
        values={kind: make for each in all_plain for kind, make in each.values.items()},
        names={field: names for each in all_plain for field, names in each.names.items()},
    )
