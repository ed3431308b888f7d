# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the recorder's diagnostics say is wrong, each with its code."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bridge_core.reasons import Coded
from bridge_core.report import NOT_ACTIVE, Status, summarise
from bridge_core.session import Level

Problem = tuple[Level, Coded]


def status_of(problems: Iterator[Problem], values: Mapping[str, Any]) -> Status:
    """Return a diagnostic that says all of them."""
    found = list(problems)
    level, message = summarise(found, 'ok')
    return Status(level, message, dict(values), [text for _, text in found])


def of_recordings(
    error: str, dropped: int, nodes: Sequence[str], node: str, *, active: bool
) -> Iterator[Problem]:
    """
    Yield what is wrong with recordings.

    :param error: of the last one. :param dropped: messages. :param node: the recorder's name.
    """
    if error:
        text = f'make room or correct folder: the last recording failed: {error}'
        yield Level.ERROR, Coded('recorder.failed', text)
    if not active:
        yield Level.WARN, NOT_ACTIVE.filled(node=node)
    elif not nodes:
        yield Level.WARN, Coded('recorder.alone', 'start the nodes: none is there to record')
    if dropped:
        text = 'use a faster disk: it was too slow for some messages'
        yield Level.WARN, Coded('recorder.slow', text)


def of_ledger(
    error: str, lost: int, anchor: str, slower: Sequence[str], overdue: Sequence[str]
) -> Iterator[Problem]:
    """
    Yield what is wrong with the ledger, and what it shows of the machine.

    :param error: of its file. :param lost: lines. :param anchor: what is wrong with the anchor.
    :param slower: how joints stop, in words. :param overdue: what was not tried lately.
    """
    if error:
        text = f'make room or correct ledger.file: {error}'
        yield Level.ERROR, Coded('recorder.ledger.failed', text)
    if lost:
        text = 'make room: some lines are lost for ever'
        yield Level.WARN, Coded('recorder.ledger.lost', text)
    if slower:
        text = 'have the brakes looked at, they stop slower than commissioned'
        yield Level.WARN, Coded('recorder.brakes', f'{text}: {"; ".join(slower)}')
    if overdue:
        names = ', '.join(overdue)
        text = f'press and release each of these, last seen to work: {names}'
        yield Level.WARN, Coded('recorder.untried', text, names=names)
    if anchor:
        yield Level.WARN, Coded('recorder.ledger.anchor', f'correct ledger.anchor: {anchor}')
