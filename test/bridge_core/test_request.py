# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a node asks of its wire: calls of the session's methods, and commands."""

import pickle

import pytest

from bridge_core.transports.request import Activate, Call, Deactivate, Request
from stage.toy_wire import Session


class Further(Session):
    """As sessions of one device that speak over several wires."""

    def request_stop(self, value: bool, now: float) -> None:
        if now > 1.0:
            raise ValueError('too late')
        super().request_stop(not value, now)


def test_call_is_that_of_the_session_that_runs() -> None:
    call = Call.of(Session.request_stop, True)
    assert call == Call('request_stop', (True,))
    for kind, requested in ((Session, True), (Further, False)):
        session = kind(0.25)
        call.on(session, 1.0)
        assert session.requested is requested
    with pytest.raises(ValueError, match='too late'):
        call.on(session, 2.0)


@pytest.mark.parametrize(
    ('what', 'is_command'),
    [
        (Call.of(Session.ping), False),
        (Activate({'port': '/dev/toy'}, resting=True), True),
        (Deactivate(), True),
    ],
)
def test_request_goes_to_another_process_as_it_is(
    what: Call | Activate | Deactivate, is_command: bool
) -> None:
    request = Request(1, 'key', what, 1.0)
    there = Request(*pickle.loads(pickle.dumps(tuple(request))))
    assert there == request
    assert type(there.what) is type(what)
    assert there.is_command is is_command
