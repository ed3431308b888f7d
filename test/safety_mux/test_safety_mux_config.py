# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a mux cannot be: refused, as no machine may run with it."""

from collections.abc import Callable
from typing import Any

import pytest

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.settings import Autonomy, EStopSource, Feedback, MuxConfig, Operator, SpeedLimit

REMOTE = Operator('remote', priority=1)
GATE = EStopSource('gate')
SECOND = Operator('second', priority=2)
OTHER = EStopSource('other', counts='when_owner', operator='second')
OWN = EStopSource('own', counts='when_owner', operator='remote')
GIVEN: dict[str, Any] = {'joints': 1, 'sources': (GATE,), 'operators': (REMOTE,)}


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({'sources': ()}, 'a mux without one is refused'),
        ({'sources': (GATE, GATE)}, 'e-stop sources must differ: gate'),
        ({'operators': ()}, 'nobody could drive'),
        ({'sources': (OWN,), 'autonomy': Autonomy()}, "no e-stop source would stop 'autonomy'"),
        (
            {'sources': (OWN,), 'operators': (REMOTE, SECOND)},
            "no e-stop source would stop 'second'",
        ),
        ({'operators': (Operator('remote', 1, timeout=0.31),)}, 'at most neutral_time, 0.3 s'),
        ({'joints': 0}, 'joints must be 1 or more'),
        ({'operators': (REMOTE, REMOTE)}, 'operators must differ: remote'),
        ({'operators': (REMOTE, Operator('b', 1))}, 'priorities must differ: 1'),
        ({'sources': (GATE, OTHER)}, "belongs to operator 'second', which does not exist"),
        ({'speed_limits': (SpeedLimit('a'), SpeedLimit('a'))}, 'speed limits must differ: a'),
    ],
)
def test_mux_that_could_not_stop_or_drive_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        MuxConfig(**{**GIVEN, **given})


@pytest.mark.parametrize(
    'given',
    [
        {},
        {'sources': (OWN,)},
        {'sources': (OWN, OTHER), 'operators': (REMOTE, SECOND)},
        {'sources': (OWN, GATE), 'autonomy': Autonomy()},
        {'operators': (), 'autonomy': Autonomy()},
        {'operators': (Operator('remote', 1, timeout=0.3),)},
    ],
)
def test_mux_with_a_stop_for_whoever_drives_is_none_of_these(given: dict[str, Any]) -> None:
    MuxConfig(**{**GIVEN, **given})


@pytest.mark.parametrize('make', [EStopSource, SpeedLimit, lambda name: Operator(name, 1)])
@pytest.mark.parametrize('name', ['', '1st', 'a/b', 'ä'])
def test_name_that_is_no_part_of_a_topic_is_refused(make: Any, name: str) -> None:
    with pytest.raises(ValueError, match='a name has letters, digits and _'):
        make(name)


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda: EStopSource('a', counts='when_owner'), 'name the operator'),
        (lambda: Operator('autonomy', 1), 'cannot be named'),
        (lambda: Operator('none', 1), 'cannot be named'),  # nobody, in ~/status
        (
            lambda: Arbiter(
                MuxConfig(**{**GIVEN, 'joints': 2}), JointLimiter([JointLimit(1.0, 1.0, 1.0)]), 0.0
            ),
            'limits are for 1 joints, not 2',
        ),
    ],
)
def test_senseless_input_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_times_are_those_of_the_parameters_as_delivered() -> None:
    """As docs/safety_mux.md lists them."""
    measured = Feedback(('left',))
    assert (measured.standstill, measured.overspeed_tolerance) == (0.2, 2.0)
    assert (measured.timeout, measured.overspeed_time) == (0.25, 0.5)
    config = MuxConfig(**GIVEN)
    assert (config.clear_time, config.neutral_time, config.hold_time) == (0.5, 0.3, 0.5)
    assert (config.stall_limit, config.stop_time, config.drive_timeout) == (0.1, 0.5, 0.25)
    assert config.reset_silence == 5.0
