# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lines that simulators obey."""

from typing import Any

import pytest

from bridge_core.simulation import help_text, obey, switch, within

COMMANDS: dict[str, tuple[str, Any]] = {
    'stick': ('-1..1', lambda seen, value: seen.append(within(value, -1, 1))),
    'radio': ('on|off', lambda seen, value: seen.append(switch(value))),
    'reboot': ('', lambda seen: seen.append('reboot')),
}


def test_lines_are_obeyed() -> None:
    seen: list[Any] = []
    for line in ('stick 0.5', 'radio on', 'reboot'):
        obey(seen, COMMANDS, line)
    assert seen == [0.5, True, 'reboot']


@pytest.mark.parametrize(
    ('line', 'says'),
    [
        ('', 'unknown command'),
        ('stik 1', 'there are: stick, radio, reboot'),
        ('stick', 'usage: stick -1..1'),
        ('stick 1 2', 'usage: stick -1..1'),
        ('stick 2', 'not within -1 to 1'),
        ('stick nan', "'nan' is no number"),
        ('stick fast', "'fast' is no number"),
        ('stick 0_1', "'0_1' is no number"),
        ('stick \u0661', 'is no number'),
        ('radio maybe', 'none of on, 1, off, 0'),
    ],
)
def test_what_makes_no_sense_says_what_would(line: str, says: str) -> None:
    seen: list[Any] = []
    with pytest.raises(ValueError, match=says):
        obey(seen, COMMANDS, line)
    assert not seen


def test_help_names_every_command() -> None:
    assert help_text(COMMANDS) == 'stick -1..1\nradio on|off\nreboot'


def test_help_says_what_may_stand_for_a_word_and_what_a_command_does() -> None:
    def cut(seen: list[Any], wire: str) -> None:
        """Cut a wire."""
        seen.append(wire)

    text = help_text({'cut': ('WIRE', cut)}, WIRE=('red', 'blue'))
    assert text.split() == ['cut', 'WIRE', 'Cut', 'a', 'wire.', 'WIRE:', 'red,', 'blue']
