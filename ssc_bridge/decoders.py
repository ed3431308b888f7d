# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How tools read captures of an SSC's line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from bridge_core.decoding import Decoders, Plain, StreamDecoder
from bridge_core.packets import CHECK_SIZE, HEAD_SIZE
import ssc_bridge.protocol as ssc

_LEAST_PACKETS = 2
_OFFSETS = range(-8, 9)
_SAFE: Mapping[str, Callable[[Mapping[str, Any], str], int | None]] = {
    'pulse': lambda values, servo: int(values[f'{servo}failsafe_us']),
    'release': lambda values, servo: 0,
    'hold': lambda values, servo: None,
}


def _configuration(value: ssc.Configuration, plain: Callable[[Any], Any]) -> dict[str, Any]:
    del plain
    aux = [function.text for function in value.aux]
    return {'config_id': value.config_id, 'inputs': value.inputs, 'aux': aux}


def count_offset(data: bytes) -> int:
    """
    Return what an SSC's byte count is beside its payload (manual 4.1); 0: nothing, or not known.

    The sums tell where a packet really ends.
    """
    found: Counter[int] = Counter()
    start = data.find(ssc.PACKETS.header)
    while start >= 0 and start + HEAD_SIZE <= len(data):
        for offset in _OFFSETS:
            size = data[start + 3] - offset
            end = start + HEAD_SIZE + size + CHECK_SIZE
            if size >= 0 and end <= len(data) and ssc.PACKETS.is_sound(data, start, end):
                found[offset] += 1
        start = data.find(ssc.PACKETS.header, start + 1)
    offset, count = max(found.items(), key=lambda each: each[1], default=(0, 0))
    return offset if count >= _LEAST_PACKETS else 0


def _rests(values: Mapping[str, Any], message: object) -> bool | None:
    """Tell whether all servos are told to go to their failsafe."""
    if not isinstance(message, ssc.PulseCommand):
        return None
    pulses = dict(enumerate(message.us, 1))
    servos = [f'servo.{name}.' for name in values['servos'] if name]
    safe = {servo: _SAFE[values[f'{servo}failsafe']](values, servo) for servo in servos}
    return all(
        us is None or pulses.get(values[f'{servo}channel']) == us for servo, us in safe.items()
    )


def _explain(data: bytes) -> tuple[str, Mapping[str, str]] | None:
    offset = count_offset(data)
    return ('other byte count', {'offset': f'{offset:+d}'}) if offset else None


DECODERS = Decoders(
    protocols=(StreamDecoder(name='ssc', parser=ssc.parser, explain=_explain, rests=_rests),),
    plain=Plain(
        values={
            ssc.Selection: lambda value, plain: str(value.text()),
            ssc.Configuration: _configuration,
        }
    ),
)
