# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Is it a stop: the command channel, and doubts about the device. Manual 2 and 4.2.1."""

from __future__ import annotations

from collections.abc import Mapping

from bridge_core.reasons import Coded
from ssc_bridge.protocol import (
    AuxInputs,
    ChannelSource,
    CommandState,
    Configuration,
    MEASURING,
    MessageType,
    PulseInputs,
    PulseOutputs,
)

Checked = ChannelSource | PulseOutputs | PulseInputs | AuxInputs  # against the configuration

_UNREAD = Coded('ssc.setup.unread', 'the configuration of the SSC is not read yet')
_HINTS = {
    CommandState.NO_SIGNAL: "switch the transmitter on, check the receiver's power and its cable "
    'to pulse input 1',
    CommandState.MS_1_5: 'switch the transmitter on, as receivers send this when they have lost '
    'it, or set lost_link_is_stop: false if it is a position of your switch',
}


def contradiction(message: Checked, configuration: Configuration) -> str:
    """Say what in a message cannot be by the configuration; empty if all can."""
    if isinstance(message, AuxInputs):
        there = [measured is not None for measured in message.measurements]
        expected = [isinstance(function, MEASURING) for function in configuration.aux]
        return '' if there == expected else 'other auxiliary channels measure than are set up to'
    is_input = isinstance(message, PulseInputs)
    expected_count = configuration.inputs if is_input else configuration.outputs
    count = len(message.selections if isinstance(message, ChannelSource) else message.us)
    return '' if count == expected_count else f'{count} channels, but {expected_count} are set up'


def another(configuration: Configuration | None, wanted: int) -> Coded | None:
    """Say that it is another SSC than wanted; None: it is that one. :param wanted: -1: any."""
    if configuration is None or wanted in (-1, configuration.config_id):
        return None
    text = (
        f'connect the SSC with configuration ID {wanted}, or set config_id: this one has '
        f'{configuration.config_id}, so nothing is sent to its outputs'
    )
    return Coded('ssc.setup.another', text)


def doubts(contradictions: Mapping[MessageType, str], *, confirmed: bool) -> list[Coded]:
    """
    Say why the device may not be what it seems.

    :param contradictions: of the newest message of each type. :param confirmed: the configuration
        was read since the device was (re)started, and since the last contradiction.
    """
    reasons = [
        Coded(
            'ssc.setup.contradicts',
            f'message {kind.value} contradicts the configuration ({text}); if that stays, '
            'power-cycle the SSC',
        )
        for kind, text in contradictions.items()
    ]
    return reasons if confirmed else [*reasons, _UNREAD]


def command_stop(state: CommandState) -> Coded:
    """Say what a state of the command channel that is a stop means, and what to do."""
    hint = _HINTS.get(state, 'move its switch, which estop_states has as a stop')
    return Coded('ssc.command.stop', f'{hint}: command channel: {state.text}', state=state.text)
