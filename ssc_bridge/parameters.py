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

_RATES = 'One each for status, channel source, pulse outputs, pulse inputs and auxiliary inputs.'


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
        'That of the SSC is fixed (manual 3.4); another only for what stands between.',
        unit='bit/s',
        minimum=9600,
        maximum=4_000_000,
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Without a status message for this long, ~/estop is true; without pulse inputs, ~/joy '
        'becomes neutral.',
        unit='s',
        minimum=0.05,
        maximum=5.0,
    ),
    Parameter(
        'poll_rates',
        [20.0, 5.0, 10.0, 50.0, 10.0],
        f'Ask for a message that does not come by itself this often; 0: never. {_RATES} Here or '
        'in message_rates, status must come twice within link_timeout, and for the failsafe '
        "'hold' channel source and pulse outputs at 4 Hz or more.",
        unit='Hz',
        minimum=0.0,
        maximum=100.0,
        check=_check_rates,
    ),
    Parameter(
        'message_rates',
        [0.0, 0.0, 0.0, 0.0, 0.0],
        'Rates in the menu of the SSC: what comes by itself, and whether the line is too slow. '
        f'{_RATES}',
        unit='Hz',
        minimum=0.0,
        maximum=50.0,
        check=_check_rates,
    ),
    Parameter(
        'first_input_nibble',
        0,
        'What stands for pulse input 1 in the channel source message; the manual leaves it open. '
        'Only for texts.',
        minimum=0,
        maximum=1,
    ),
    Parameter(
        'config_id',
        -1,
        'User configuration ID that the SSC must have (manual 3.2.2): with another one it is a '
        'stop, and nothing is sent to its outputs. -1: any.',
        minimum=-1,
        maximum=255,
    ),
    Parameter(
        'lockout_on_start',
        False,
        'Lock the configuration menus out as soon as the SSC is there (message 98).',
    ),
    Parameter(
        'estop_states',
        ['no signal'],
        'Which states of the command channel (pulse input 1) are a stop, beside a lost '
        "transmitter. [''] for none.",
        choices=('', *(state.text for state in CommandState)),
        section='stops',
    ),
    Parameter(
        'lost_link_is_stop',
        True,
        'Take 1.5 ms on the command channel for a lost transmitter, which is a stop: the manual '
        '(2) has receivers set up so. False: 1.5 ms is a position of your switch, and a lost '
        'transmitter shows only if the receiver then ends its pulses.',
    ),
    Parameter(
        'axes',
        ['turn', 'forward'],
        "Names of the axes of ~/joy, in this order; [''] for none. Left and forward are to be "
        'positive.',
        section='~/joy: an RC receiver as operator',
    ),
    Parameter('buttons', ['deadman'], "Names of the buttons of ~/joy; [''] for none."),
    Parameter(
        'plausible_us',
        [700, 2300],
        'The least and the greatest pulse of an axis or button that is believed; another is '
        'faulty.',
        unit='µs',
        minimum=0,
        maximum=MAX_PULSE_US,
        check=_check_plausible,
    ),
    TOLERATE_FAULTY_AXES,
    Parameter(
        'servos',
        [''],
        "Names of pulse outputs for ~/servo_command; [''] for none.",
        section='pulse outputs',
    ),
    Parameter(
        'failsafe',
        'release',
        'What outputs without a name do when no command is fresh or allowed: hold the last pulse, '
        'or release (no pulse).',
        choices=('hold', 'release'),
    ),
    Parameter(
        'command_rate',
        50.0,
        'How often commands to the pulse outputs are sent (message 20).',
        unit='Hz',
        minimum=1.0,
        maximum=200.0,
    ),
    Parameter(
        'command_timeout',
        0.25,
        'A command or an ~/estop_in older than this brings the outputs to their failsafe.',
        unit='s',
        minimum=0.02,
        maximum=5.0,
    ),
    Parameter(
        'keep_aux_outputs',
        False,
        'Leave the auxiliary outputs alone at a stop, and obey during one. False: a stop undoes '
        'what was set, and requests during one are refused.',
        section='auxiliary outputs',
    ),
)

CALIBRATION = (
    _channel('Pulse input of the axis; input 1 is the command channel.', MAX_INPUTS),
    _pulse('min_us', 1000, 'Pulse at the one end.'),
    _pulse('centre_us', 1500, 'Pulse at rest.'),
    _pulse('max_us', 2000, 'Pulse at the other end; this one is 1.'),
    Parameter('reversed', False, 'True: min_us is 1 instead.'),
    Parameter('deadband', 0.05, 'Deflection that still is 0.', minimum=0.0, maximum=0.9),
)

BUTTON = (
    _channel('Pulse input of the button or switch.', MAX_INPUTS),
    Parameter(
        'thresholds_us',
        [1500],
        'The button is the number of these that the pulse is above. Rising: [1300, 1700] makes 0, '
        '1, 2 of a switch with three positions.',
        unit='µs',
        minimum=1,
        maximum=MAX_PULSE_US,
    ),
    Parameter('reversed', False, 'True: the number that the pulse is not above instead.'),
)

SERVO = (
    _channel('Pulse output of the servo.', MAX_OUTPUTS),
    _pulse('min_us', 1000, 'Pulse of position -1; no shorter one is ever sent but 0, no pulse.'),
    _pulse('centre_us', 1500, 'Pulse of position 0.'),
    _pulse('max_us', 2000, 'Pulse of position 1; no longer one is ever sent.'),
    Parameter('reversed', False, 'Turn the sign of the position round.'),
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
        'When no command is fresh or allowed: a pulse of its own, hold the last one, or release '
        '(no pulse).',
        choices=('pulse', 'hold', 'release'),
    ),
    _pulse('failsafe_us', 1500, 'The pulse, where failsafe is pulse; from min_us to max_us.'),
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
