# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A thousand messages with each kind of fault; and what the count finds in a worse channel."""

from __future__ import annotations

from typing import Any

import pytest

from assurance import black_channel
from assurance.black_channel import failures, FAULTS
from bridge_core import proof
from bridge_core.proof import Reader

COUNT = 1000


@pytest.mark.parametrize('fault', FAULTS)
def test_each_fault_is_noticed_and_no_sound_message_refused(fault: str) -> None:
    assert not failures(fault, COUNT)


def test_command_tells_by_its_status_whether_all_was_noticed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert black_channel.main(['-n', '10', 'sound', 'delay']) == 0
    assert '| sound | 10 |  | 0 false alarms |' in capsys.readouterr().out
    monkeypatch.setattr(proof, 'crc32', lambda data: 0)
    assert black_channel.main(['-n', '1000', 'corruption']) == 1


class Believing(Reader):
    """A reader with a hole: each attribute that is set again keeps a check from working."""

    forgets: tuple[str, Any] = ('', None)

    def hear(self, data: bytes, now: float) -> Any:
        setattr(self, *self.forgets)
        return super().hear(data, now)


@pytest.mark.parametrize(
    ('fault', 'attribute', 'value'),
    [
        ('repetition', '_number', 0),
        ('wrong order', '_number', 0),
        ('loss', '_stops', 0),
        ('sound', '_stops', 7),
        ('masquerade', 'writer', None),
    ],
)
def test_hole_in_the_reader_is_found(
    monkeypatch: pytest.MonkeyPatch, fault: str, attribute: str, value: Any
) -> None:
    monkeypatch.setattr(Believing, 'forgets', (attribute, value))
    monkeypatch.setattr(black_channel, 'Reader', Believing)
    assert failures(fault, 100)


@pytest.mark.parametrize('fault', ['delay', 'wrong address', 'insertion'])
def test_reader_that_takes_any_answer_for_its_own_is_found(
    monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    def believe(self: Reader, found: proof.Proof) -> None:
        self.as_of = max([self.as_of, *(self._asked[-1] for _ in found.answers)])
        if fault == 'insertion':
            self.as_of = max([self.as_of, *(asked / 1e9 for _, asked in found.answers)])

    monkeypatch.setattr(Reader, '_note_answer', believe)
    if fault == 'delay':  # what it is told is as of now
        monkeypatch.setattr(Reader, 'age', lambda self, now: 0.0)
    assert failures(fault, 100)
