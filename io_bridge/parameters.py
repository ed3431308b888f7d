# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the I/O bridge beside those that all bridges share."""

from bridge_core.parameters import check_topic, Parameter
from io_bridge.protocol import OUTPUTS

_MAX_LINE = 0xFFFF

PARAMETERS = (
    Parameter(
        'transport',
        'rtu',
        'rtu: Modbus on a serial line. tcp: Modbus TCP. Both need pymodbus. gpio: lines of this '
        'computer; needs gpiod.',
        choices=('rtu', 'tcp', 'gpio'),
        section='the port',
    ),
    Parameter(
        'port',
        '/dev/io_box',
        'rtu: device file. tcp: socket://host:502. gpio: such as /dev/gpiochip0.',
    ),
    Parameter('baud', 19200, 'rtu: of the line, 8N1.', unit='bit/s', minimum=1200, maximum=4e6),
    Parameter('unit', 1, 'Modbus: the address of the box.', minimum=1, maximum=255),
    Parameter(
        'bias',
        'as-is',
        'gpio: resistors of the inputs. as-is: as they are.',
        choices=('as-is', 'disabled', 'pull-up', 'pull-down'),
    ),
    Parameter(
        'active_low',
        False,
        'gpio: an input is on while its level is low, as of a closed contact to ground.',
    ),
    Parameter(
        'poll_rate', 50.0, 'How often inputs are read.', unit='Hz', minimum=5.0, maximum=500.0
    ),
    Parameter(
        'answer_time',
        0.05,
        'An answer that takes longer is lost. link_timeout holds four of them or more.',
        unit='s',
        minimum=0.002,
        maximum=1.0,
    ),
    Parameter(
        'link_timeout',
        0.25,
        'Inputs that were asked for longer ago are a stop.',
        unit='s',
        minimum=0.05,
        maximum=5.0,
    ),
    Parameter(
        'estop_names',
        ['estop'],
        'E-stop buttons, as messages name them; one or more.',
        section='inputs: lines are discrete inputs from 0, or offsets on the chip',
    ),
    Parameter(
        'estop_lines',
        [0, 1],
        'Two lines each e-stop: its first and its second channel.',
        minimum=0,
        maximum=_MAX_LINE,
    ),
    Parameter(
        'estop_kind',
        'equivalent',
        'equivalent: both channels are closed while released. antivalent: the second one is open.',
        choices=('equivalent', 'antivalent'),
    ),
    Parameter(
        'discrepancy_time',
        0.5,
        'Channels that disagree for longer are a fault, until both were pressed.',
        unit='s',
        minimum=0.02,
        maximum=10.0,
    ),
    Parameter(
        'debounce',
        0.1,
        'How long a button must be released until its stop ends. It delays no stop.',
        unit='s',
        minimum=0.0,
        maximum=2.0,
    ),
    Parameter(
        'reset_line',
        -1,
        'Reset button, on while pressed. -1: none.',
        minimum=-1,
        maximum=_MAX_LINE,
    ),
    Parameter(
        'key_lines',
        [-1],
        'Positions of a key switch but the first one, which has no line. [-1]: no key switch.',
        minimum=-1,
        maximum=_MAX_LINE,
    ),
    Parameter(
        'key_speeds',
        [0.3, 1.0],
        '~/speed_limit of each position. The first one, with no line on, is the least: a cut wire '
        'chooses it.',
        minimum=0.0,
        maximum=1.0,
    ),
    Parameter(
        'outputs',
        [''],
        f'What is connected, in the order of output_lines: {", ".join(OUTPUTS)}. Empty: nothing.',
        choices=('', *OUTPUTS),
        fixed=True,  # without outputs the node does not listen to state_topic
        section='outputs: lines are coils from 0, or offsets on the chip',
    ),
    Parameter(
        'output_lines',
        [0],
        'One line each of outputs. Modbus: in any order, but without gaps.',
        minimum=0,
        maximum=_MAX_LINE,
    ),
    Parameter(
        'state_topic',
        'safety_mux/state',
        'The state that outputs show.',
        check=check_topic,
        fixed=True,
    ),
    Parameter(
        'horn_time',
        0.5,
        'How long the horn sounds when the machine becomes ACTIVE.',
        unit='s',
        minimum=0.0,
        maximum=10.0,
    ),
)
