"""
Is it a stop: the command channel, and doubts about the device. Manual 2 and 4.2.1.

Nothing that this node sends makes the device report a stop, so there is no echo to tell apart.
"""

from __future__ import annotations

from collections.abc import Collection

from bridge_core.session import Verdict
from ssc_bridge.protocol import AuxInputs
from ssc_bridge.protocol import ChannelSource
from ssc_bridge.protocol import CommandState
from ssc_bridge.protocol import Configuration
from ssc_bridge.protocol import MEASURING
from ssc_bridge.protocol import MessageType
from ssc_bridge.protocol import PulseInputs
from ssc_bridge.protocol import PulseOutputs

Checked = ChannelSource | PulseOutputs | PulseInputs | AuxInputs

_HINTS = {
    CommandState.NO_SIGNAL: 'no pulses from the RC receiver; switch the transmitter on, check '
    "the receiver's power and its cable to pulse input 1",
    CommandState.MS_1_5: 'receivers set up so send this when the radio link is lost; switch the '
    'transmitter on',
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


class StopJudge:
    """
    Judges what is known of the device.

    :param estop_states: states of the command channel that are a stop.
    """

    def __init__(self, estop_states: Collection[CommandState]) -> None:
        self.confirmed = False  # the configuration was read since the device was (re)started
        self.contradictions: dict[MessageType, str] = {}  # of the newest message of each type
        self._estop_states = estop_states

    def forget(self) -> None:
        """Begin anew with a device that may be another one."""
        self.confirmed = False
        self.contradictions.clear()

    def contradicted(self, kind: MessageType, text: str) -> None:
        """Note what is wrong with a message; the configuration has to be read again."""
        self.confirmed = False
        self.contradictions[kind] = text

    def judge(self, state: CommandState | None) -> Verdict:
        """Return what it all means, with this state of the command channel."""
        reasons = [
            f'message {kind.value} contradicts the configuration ({text}); if that stays, '
            'power-cycle the SSC'
            for kind, text in self.contradictions.items()
        ]
        if not self.confirmed:
            reasons.append('the configuration of the SSC is not read yet')
        if state is not None and state in self._estop_states:
            hint = _HINTS.get(state, 'estop_states has it as a stop')
            reasons.append(f'command channel: {state.text}; {hint}')
        return Verdict(bool(reasons), bool(reasons), tuple(reasons))
