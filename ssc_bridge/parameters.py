# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The parameters of the SSC bridge beside those that all bridges share.

Three lists name things: ``axes`` and ``buttons`` of Joy, and ``servos``. Each name brings
parameters of its own, such as ``calibration.turn.channel`` or ``servo.pan.min_us``.
"""

from collections.abc import Mapping
from typing import Any

from bridge_core.parameters import Parameter, TOLERATE_FAULTY_AXES, with_named
from ssc_bridge.protocol import (
    BAUD,
    CommandState,
    MAX_INPUTS,
    MAX_OUTPUTS,
    MAX_PULSE_US,
    REPEATED,
)


def _check_rates(values: list[float]) -> None:
    if len(values) != len(REPEATED):
        raise ValueError(f'{len(REPEATED)} numbers are needed, for messages 10 to 14')


def _check_plausible(values: list[int]) -> None:
    if len(values) != 2 or not values[0] < values[1]:
        raise ValueError('the least and the greatest pulse are needed')


def _pulse(name: str, default: int, description: str) -> Parameter:
    return Parameter(name, default, description, unit='µs', minimum=1, maximum=MAX_PULSE_US)


def _channel(description: str, maximum: int) -> Parameter:
    return Parameter('channel', 1, description, minimum=1, maximum=maximum)


GENERAL = (
    Parameter(
        'port',
        '/dev/ssc',
        'Device file, or socket://host:port, or rfc2217://host:port.',
        section='the port, and what is asked of the SSC',
    ),
    Parameter(
        'baud',
        BAUD,
        'Fixed in the SSC (manual 3.4). Another one is for an adapter in between.',
        unit='bit/s',
        minimum=9600,
        maximum=4_000_000,
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Without a status for this long ~/estop is true; without pulse inputs ~/joy is neutral.',
        unit='s',
        minimum=0.05,
        maximum=5.0,
    ),
    Parameter(
        'poll_rates',
        [20.0, 5.0, 10.0, 50.0, 10.0],
        'How often to ask for what does not come by itself; 0: never. For status, channel source, '
        'pulse outputs, pulse inputs, auxiliary inputs. Status: twice within link_timeout. '
        "'hold': the next two at 4 Hz.",
        unit='Hz',
        minimum=0.0,
        maximum=100.0,
        check=_check_rates,
    ),
    Parameter(
        'message_rates',
        [0.0, 0.0, 0.0, 0.0, 0.0],
        'The rates in the menu of the SSC, in the order of poll_rates.',
        unit='Hz',
        minimum=0.0,
        maximum=50.0,
        check=_check_rates,
    ),
    Parameter(
        'first_input_nibble',
        0,
        'Number of pulse input 1 in channel source messages. For texts only.',
        minimum=0,
        maximum=1,
    ),
    Parameter(
        'config_id',
        -1,
        'Configuration ID of the SSC (manual 3.2.2); another one is a stop. -1: any.',
        minimum=-1,
        maximum=255,
    ),
    Parameter(
        'lockout_on_start',
        False,
        'Lock the configuration menus out (message 98).',
    ),
    Parameter(
        'estop_states',
        ['no signal'],
        "States of the command channel (pulse input 1) that are a stop; ['']: none.",
        choices=('', *(state.text for state in CommandState)),
        section='stops',
    ),
    Parameter(
        'lost_link_is_stop',
        True,
        '1.5 ms on the command channel is a lost transmitter (manual 2). False: a position of '
        'your switch.',
    ),
    Parameter(
        'axes',
        ['turn', 'forward'],
        "Axes of ~/joy, in order; ['']: none. Left and forward are positive.",
        section='~/joy: an RC receiver as operator',
    ),
    Parameter('buttons', ['deadman'], "Buttons of ~/joy; ['']: none."),
    Parameter(
        'plausible_us',
        [700, 2300],
        'Least and greatest pulse of a sound control.',
        unit='µs',
        minimum=0,
        maximum=MAX_PULSE_US,
        check=_check_plausible,
    ),
    TOLERATE_FAULTY_AXES,
    Parameter(
        'servos',
        [''],
        "Pulse outputs for ~/servo_command; ['']: none.",
        section='pulse outputs',
    ),
    Parameter(
        'failsafe',
        'release',
        'Of outputs without a name: the last pulse, or none.',
        choices=('hold', 'release'),
    ),
    Parameter(
        'command_rate',
        50.0,
        'How often commands go to the pulse outputs (message 20).',
        unit='Hz',
        minimum=1.0,
        maximum=200.0,
    ),
    Parameter(
        'command_timeout',
        0.25,
        'When a command or ~/estop_in is stale: outputs go to their failsafe.',
        unit='s',
        minimum=0.02,
        maximum=5.0,
    ),
    Parameter(
        'keep_aux_outputs',
        False,
        'A stop leaves the auxiliary outputs alone, and requests are obeyed. False: it undoes '
        'what was set.',
        section='auxiliary outputs',
    ),
)

CALIBRATION = (
    _channel('Pulse input; input 1 is the command channel.', MAX_INPUTS),
    _pulse('min_us', 1000, 'Pulse at the one end.'),
    _pulse('centre_us', 1500, 'Pulse at rest.'),
    _pulse('max_us', 2000, 'Pulse at the other end: 1.'),
    Parameter('reversed', False, 'min_us is 1 instead.'),
    Parameter('deadband', 0.05, 'Deflection that still is 0.', minimum=0.0, maximum=0.9),
)

BUTTON = (
    _channel('Pulse input.', MAX_INPUTS),
    Parameter(
        'thresholds_us',
        [1500],
        'In rising order, within plausible_us; the button is the number of these below the pulse.',
        unit='µs',
        minimum=1,
        maximum=MAX_PULSE_US,
    ),
    Parameter('reversed', False, 'Count those not below the pulse.'),
)

SERVO = (
    _channel('Pulse output.', MAX_OUTPUTS),
    _pulse('min_us', 1000, 'Pulse of position -1. Only 0, no pulse, is shorter.'),
    _pulse('centre_us', 1500, 'Pulse of position 0.'),
    _pulse('max_us', 2000, 'Pulse of position 1. None is longer.'),
    Parameter('reversed', False, 'Turn the sign round.'),
    Parameter(
        'rate_us_per_s',
        2000.0,
        'Greatest change of the pulse; a failsafe acts at once.',
        unit='µs/s',
        minimum=1.0,
        maximum=1e6,
    ),
    Parameter(
        'failsafe',
        'release',
        'Without a fresh, allowed command: its own pulse, the last one, or none.',
        choices=('pulse', 'hold', 'release'),
    ),
    _pulse('failsafe_us', 1500, 'Of failsafe pulse alone; from min_us to max_us.'),
)

# What the names in the default lists mean: a stick on inputs 2 and 3, a switch on input 4.
DEFAULTS: dict[str, Any] = {
    'calibration.turn.channel': 2,
    'calibration.turn.reversed': True,
    'calibration.forward.channel': 3,
    'button.deadman.channel': 4,
}


def parameter_table(given: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return all parameters, those of the names in the given (or default) lists included."""
    groups = (
        ('axes', 'calibration', CALIBRATION),
        ('buttons', 'button', BUTTON),
        ('servos', 'servo', SERVO),
    )
    return with_named(GENERAL, groups, given, DEFAULTS)
