# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reset, trip and status of a mux, and clearing the errors of a drive, where ROS has no command line.

``ros2 service call`` and ``ros2 topic echo`` do the same where it has one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import sys
from typing import Any, NamedTuple

from bridge_core.options import number_within
from rugged_teleop.command_line import full_name, Parser

_MUX, _DRIVE = '/safety_mux', '/esi_drive_bridge'


class _Command(NamedTuple):
    """
    What a command is for.

    :param name: of its service, or topic. :param node: who has it, by default.
    :param example: another node. :param repeats: asked twice, it does no more than once.
    """

    text: str
    name: str
    node: str
    example: str
    repeats: bool = False


_COMMANDS = {
    'clear': _Command(
        'Have a drive clear the errors that it keeps: first mend what caused them.',
        'clear_errors',
        _DRIVE,
        '/front/esi_drive_bridge',
    ),
    'reset': _Command(
        'Reset a mux: STOPPED becomes READY, and nothing moves. Do it where you see the machine.',
        'reset',
        _MUX,
        '/left/safety_mux',
    ),
    'status': _Command(
        'Say whether the machine may move, who has control, what is in the way, and what to do.',
        'status',
        _MUX,
        '/left/safety_mux',
    ),
    'trip': _Command(
        'Trip a mux: STOPPED until a reset. No emergency stop: use the button for that.',
        'trip',
        _MUX,
        '/left/safety_mux',
        repeats=True,
    ),
}
_STATUS = (
    'Exit status: 0 it was done, or said; 1 it was refused, or nothing answers; 2 wrong arguments.'
)
_EXAMPLES = """\
examples:
  {prog} --node {example}
  {prog} --wait 30    # s; on a network that is slow to be discovered
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line; the command is the last word of ``prog``."""
    command = _COMMANDS[prog.split()[-1]]
    result = Parser(
        prog=prog,
        description=f'{command.text}\n\n{_STATUS}',
        epilog=_EXAMPLES.format(prog=prog, example=command.example),
    )
    result.add_argument(
        '--node',
        type=full_name,
        default=command.node,
        help=f'full name of the node ({command.node})',
    )
    result.add_argument(
        '--wait',
        type=number_within(0.1, 600.0),
        default=10.0,
        metavar='SECONDS',
        help='for its answer, 0.1 to 600 (10)',
    )
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop status') -> None:
    """Ask; the command's entry point."""
    options = parser(prog).parse_args(arguments)
    command = _COMMANDS[prog.split()[-1]]
    from rugged_teleop.asker import Asker  # lazily: the help needs no ROS

    with Asker(options.node, command.name, options.wait) as asker:
        if command.name == 'status':
            status = asker.hear_status()
            done, text = status is not None, _told(status or {})
        else:
            done, text = asker.ask(repeats=command.repeats)
        text = text or asker.absence()
    print(text if done else f'{prog}: {text}', file=sys.stdout if done else sys.stderr)
    sys.exit(0 if done else 1)


def _told(values: Mapping[str, Any]) -> str:
    """Return the values of ~/status in lines, with the remedy of each inhibit."""
    if not values:
        return ''
    from bridge_core.reasons import from_values
    from rugged_teleop.reasons import explained, to_do

    owner, state = values.get('owner', 'none'), values.get('state', '?')
    lines = [state + ('' if owner == 'none' else f': {owner} has control')]
    texts = [
        text
        for kind in ('inhibit ', 'warning ', 'slowed')
        for key, text in values.items()
        if key.startswith(kind)
    ]
    reasons = from_values(values, texts)
    held = sum(key.startswith('inhibit ') for key in values)
    first = to_do(reasons[:held], state)
    lines += [] if first is None else [first.line]
    for reason, code, steps in explained(reasons, first.code if first else ''):
        arrow = f'\n    -> {steps}' if steps else ''
        lines.append(f'- {reason}{arrow}' + (f' [{code}]' if code else ''))
    if 'last reset' in values:
        lines.append(f'last reset: {values["last reset"]}')
    return '\n'.join(lines)
