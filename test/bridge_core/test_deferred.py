# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What waits behind a stop."""

from __future__ import annotations

import pytest

from bridge_core.deferred import Deferred


def test_event_that_cannot_be_published_lets_none_overtake_those_behind_it() -> None:
    told: list[str] = []

    def tell(event: str) -> None:
        if event == 'bad':
            raise ValueError('a fault')
        told.append(event)

    deferred = Deferred(tell, None)
    deferred.hold(1.0)
    for event in ('first', 'bad', 'second'):
        deferred.tell(event)
    with pytest.raises(ValueError, match='a fault'):
        deferred.flush()
    deferred.tell('third')
    deferred.log_late(1.05)  # as it is at each repeat of the stop
    assert deferred.due <= 1.05
    deferred.flush()
    assert told == ['first', 'second', 'third']
