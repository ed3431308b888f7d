# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How tools read captures of a drive's line: both directions look alike but for their size."""

from __future__ import annotations

from functools import partial

from bridge_core.decoding import Decoders, Plain, StreamDecoder
import esi_drive_bridge.protocol as esi


def _enables(message: object) -> bool | None:
    if not isinstance(message, esi.Command):
        return None
    return any(axis.enable for axis in message.axes)


def _pair(suffix: str, layout: esi.Layout) -> tuple[StreamDecoder, StreamDecoder]:
    status, command = partial(esi.status_parser, layout), partial(esi.command_parser, layout)
    return (
        StreamDecoder(name=f'esi_status{suffix}', parser=status),
        StreamDecoder(
            name=f'esi_command{suffix}', parser=command, by_device=False, enables=_enables
        ),
    )


DECODERS = Decoders(
    protocols=(*_pair('', esi.Layout.DUAL), *_pair('_compact', esi.Layout.COMPACT)),
    plain=Plain(names={(esi.Command, 'axes'): ('a', 'b'), (esi.Status, 'axes'): ('a', 'b')}),
)
