# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Is it a stop, and whose: manual 4.1.1, 4.1.3 and 5.1.2.

Withheld VRPO make the BU report an external link error and open its relays. That error is what
this node asked for. Fed into another device's chain, it would hold both stopped for ever, so it is
told apart here, from its beginning until the remote is armed again.
"""

from __future__ import annotations

import math

from bridge_core.reasons import Coded, passed_on
from bridge_core.session import Verdict
from vm110_bridge.protocol import (
    BuState,
    LinkStatus,
    PeriodicInput,
    RELAYS_CLOSED,
    RuState,
    state_name,
)

# The BU reports the missing VRPO after 2 s (5.1.2). An error that comes sooner is not our doing.
LEAST_SILENCE = 1.5
# An armed BU that has not opened its relays after this gets VRPO of somebody else, or is broken.
OBEY_TIME = 3.0
# A VRPI may be on its way when VRPO begin to flow again.
ECHO_DELAY = 0.5
# What a BU may say of EG-Link while it gets no VRPO; the others are faults of its own.
_WITHOUT_OUTPUT = (LinkStatus.OPERATIONAL, LinkStatus.NO_LINK, LinkStatus.DATA_ERROR)
_EC_IN_ORDER = (LinkStatus.UNUSED, LinkStatus.OPERATIONAL)

_TO_DO = {
    BuState.INITIAL: Coded(
        'vm110.bu.initial', 'wait until the base unit has started, then arm a remote'
    ),
    BuState.STOPPED: Coded(
        'vm110.bu.stopped', 'release the stop switch on the remote, then rearm'
    ),
    BuState.EXTERNAL_LINK_ERROR: Coded(
        'vm110.bu.external', 'check the EC-Link and EG-Link cables, then rearm'
    ),
    BuState.BLOCKED: Coded('vm110.bu.blocked', 'turn on the remote and rearm'),
    BuState.FAILED: Coded(
        'vm110.bu.failed', 'switch the base unit off and on, else have it repaired'
    ),
}
_UNKNOWN = 'check which version of the manual the system follows'
_ECHO = Coded(
    'vm110.hold.echo',
    'rearm the remote when the cause of hold_output is gone: BU state is External link error, as '
    'hold_output asks (VRPO are withheld)',
)
_ECHO_STILL = Coded(
    'vm110.hold.echo',
    'rearm the remote: BU state is External link error, still from hold_output, which asks no '
    'more',
)


class StopJudge:
    """Judges VRPI, knowing whether VRPO are withheld. :param now: the port was opened then."""

    def __init__(self, now: float = 0.0) -> None:
        self._holding = False
        self._output_at = now  # the last VRPO, or when the first one could have gone
        self._silence = 0.0  # seconds without VRPO when the last hold ended
        self._released_at = -math.inf
        self._resumed_at = now  # VRPO began to flow, or did so again after LEAST_SILENCE
        self._newest = PeriodicInput()  # Initial, a stop
        self._taken_at = self._armed_at = now  # of the newest; while it is Armed, of the first
        self._late = Verdict()  # the worst of the VRPI that the newest has overtaken
        self._echo = False  # the external link error is our doing, as hold_output asked
        self._missed = False  # VRPO were missing when it began

    def hold(self, holding: bool, now: float) -> None:
        """Note whether VRPO are withheld on request from ``now`` on."""
        if self._holding and not holding:
            self._silence = now - self._output_at
            self._released_at = now
        self._holding = holding

    def output_sent(self, now: float) -> None:
        """Note that a VRPO went out."""
        if now - self._output_at >= LEAST_SILENCE:
            self._resumed_at = now
        self._output_at = now

    @property
    def is_disobeyed(self) -> bool:
        """Whether the newest VRPI says Armed although VRPO had been withheld for long."""
        armed = self._newest.bu_state == BuState.ARMED
        withheld_for = self._taken_at - max(self._output_at, self._armed_at)
        return self._holding and armed and withheld_for >= OBEY_TIME

    def take(self, vrpi: PeriodicInput, now: float) -> None:
        """Take the newest VRPI."""
        if not _in_error(vrpi):
            self._echo = self._missed = False
        elif not _in_error(self._newest):
            self._echo = self._may_be_ours(now)
            silent = now - self._output_at >= LEAST_SILENCE
            self._missed = silent or now - self._resumed_at < ECHO_DELAY
        if self._newest.bu_state != BuState.ARMED:
            self._armed_at = now
        self._taken_at = now
        self._newest, self._late = vrpi, Verdict()

    def take_late(self, vrpi: PeriodicInput) -> None:
        """Take a VRPI that a newer one has overtaken: only a stop in it counts, until the next."""
        self._late = max(self._late, self._verdict_of(vrpi), key=_severity)

    def verdict(self) -> Verdict:
        """Return what the newest VRPI means, with those that it has overtaken."""
        return max(self._verdict_of(self._newest), self._late, key=_severity)

    def _verdict_of(self, vrpi: PeriodicInput) -> Verdict:
        # Do missing VRPO alone explain it?
        links = vrpi.eg_link in _WITHOUT_OUTPUT and vrpi.ec_link in _EC_IN_ORDER
        only_output = _in_error(vrpi) and links
        echo = self._echo and only_output
        own = [] if echo else _bu_reasons(vrpi, missed=self._missed and only_output)
        own += _ru_reasons(vrpi)
        reasons = [_ECHO if self._holding else _ECHO_STILL, *own] if echo else own
        return Verdict(bool(reasons), bool(own), reasons=tuple(reasons))

    def _may_be_ours(self, now: float) -> bool:
        if self._holding:
            return now - self._output_at >= LEAST_SILENCE
        return self._silence >= LEAST_SILENCE and now - self._released_at < ECHO_DELAY


def _severity(verdict: Verdict) -> int:
    return verdict.estop + verdict.own_estop


def _in_error(vrpi: PeriodicInput) -> bool:
    return vrpi.bu_state == BuState.EXTERNAL_LINK_ERROR


def _bu_reasons(vrpi: PeriodicInput, *, missed: bool) -> list[Coded]:
    """
    Say why the BU demands a stop; a state that nobody knows is one.

    :param missed: an external link error is explained by VRPO that were missing.
    """
    state = vrpi.bu_state
    if not isinstance(state, BuState):
        return [Coded('vm110.state.unknown', f'{_UNKNOWN}: BU state is {state_name(state)}')]
    if state >= RELAYS_CLOSED:
        return []
    if missed:
        text = (
            'rearm the remote; if it comes back, check the EC-Link and EG-Link cables: BU state '
            'is External link error, VRPO were missing while this node was not running or held up'
        )
        return [Coded('vm110.bu.missed', text)]
    text = f'{_TO_DO[state]}: BU state is {state_name(state)}'
    if state == BuState.EXTERNAL_LINK_ERROR:
        text += f', EG-Link {state_name(vrpi.eg_link)}, EC-Link {state_name(vrpi.ec_link)}'
    return [passed_on(_TO_DO[state], text)]


def _ru_reasons(vrpi: PeriodicInput) -> list[Coded]:
    """Say why the RU demands a stop, where the BU does not say the same."""
    if not isinstance(vrpi.ru_state, RuState):
        return [
            Coded('vm110.state.unknown', f'{_UNKNOWN}: RU state is {state_name(vrpi.ru_state)}')
        ]
    if vrpi.ru_state != RuState.STOPPED or vrpi.bu_state == BuState.STOPPED:
        return []
    text = (
        "release the remote's stop switch, then rearm: the armed remote has stopped (stop switch, "
        'free fall, shock or a fatal error)'
    )
    return [Coded('vm110.ru.stopped', text)]
