# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Is it a stop, and whose: manual 6.1, 6.6, 7.3.2 and 7.3.4.

What this node asks of the VSC by its own heartbeat comes back as an E-stop of the VSC. Fed into
another device's chain, that echo would hold both stopped for ever, so it is told apart here.
"""

from __future__ import annotations

import math

from bridge_core.reasons import Coded
from bridge_core.session import Verdict
from fort_vsc_bridge.protocol.messages import Heartbeat
from fort_vsc_bridge.protocol.values import (
    CONNECTED_MODES,
    estop_sources,
    EStopBits,
    mode_name,
    MODES_AFTER_A_STOP,
)

# The VSC may answer our heartbeat with some delay; 500 ms is its own limit for ours (7.3.4).
ECHO_DELAY = 0.5
OBEY_TIME = 2.0 * ECHO_DELAY  # a VSC that does not stop within this does not hear us
ANYBODY = 'the remote, the wired input or a computer (USB HID does not tell which)'
_NO_REMOTE: dict[int, Coded] = {
    mode: Coded(
        'fort.remote.off',
        'switch the remote on, bring it into reach, acknowledge on it: mode is '
        f'{mode_name(mode)}, so none is connected, or a stop not acknowledged yet',
        mode=mode_name(mode),
    )
    for mode in MODES_AFTER_A_STOP
}
_STRANGE = Coded(
    'fort.mode.strange',
    'restart the VSC if this lasts, look at its LED, check its firmware: mode is '
    '{mode}, so it does not say that it works',
)
_USER = 'VSC reports e-stop: USER (this computer)'
_NOT_ASKED_NOW = Coded(
    'fort.estop.held', f'acknowledge on the remote: {_USER}, not asked any more'
)
_NEVER_ASKED = Coded(
    'fort.estop.held',
    f'acknowledge on the remote: {_USER}, not asked by this node; did its heartbeats fail '
    '(User E-STOP Timeout), or an earlier one leave it set?',
)


class StopJudge:
    """
    Judges heartbeats of the VSC, knowing what was asked of it.

    :param transition_time: seconds of modes outside table 12 until they are the VSC's own stop:
        one that stands between two others is no demand, and may come with every acknowledgement.
    """

    def __init__(self, transition_time: float) -> None:
        self._transition_time = transition_time
        self._strange_since = math.inf  # modes outside table 12 have come one after the other
        self._asked = ''  # what ends the stop that our last heartbeat asked for; empty: none
        self._echo = False  # USER bits are our doing
        self._echo_heard = False  # they were seen since we asked last
        self._heard_at = self._asked_at = self._released_at = 0.0

    def asked(self, remedy: str, now: float) -> None:
        """Note what ends the stop that our heartbeat asks for from ``now`` on; empty: none."""
        if remedy and not self._asked:
            # Bits that stood before, too: while we ask they do not clear, and two devices whose
            # stops ask for each other's would never be clear.
            self._echo = True
            self._echo_heard = False
            self._asked_at = now
        elif self._asked and not remedy:
            self._released_at = now
        self._asked = remedy

    @property
    def awaits_stop(self) -> bool:
        """Whether the newest heartbeat came so long after we asked that it ought to say stop."""
        return bool(self._asked) and self._heard_at - self._asked_at >= OBEY_TIME

    @property
    def becomes_own_at(self) -> float:
        """The moment from which the newest mode is the VSC's own stop; infinite: never."""
        return self._strange_since + self._transition_time

    def heard(self, heartbeat: Heartbeat, now: float) -> None:
        """Keep USER bits ours until they are seen clear: the VSC may hold them for a while."""
        self._heard_at = now
        strange = heartbeat.mode not in CONNECTED_MODES | MODES_AFTER_A_STOP
        self._strange_since = min(self._strange_since, now) if strange else math.inf
        if heartbeat.estop & EStopBits.USER:
            self._echo_heard = self._echo
        elif not self._asked and (self._echo_heard or now - self._released_at >= ECHO_DELAY):
            self._echo = False

    def judge(self, heartbeat: Heartbeat, now: float) -> Verdict:
        """Return what the newest heartbeat means; it was heard."""
        if heartbeat.estop == 0 and heartbeat.mode in CONNECTED_MODES:
            return Verdict()
        user = heartbeat.estop & EStopBits.USER
        others = heartbeat.estop & ~int(EStopBits.USER)
        reasons = []
        if others:
            reasons.append(_pressed(heartbeat, others))
        if user:
            reasons.append(self._user_reason())
        if heartbeat.mode in _NO_REMOTE:
            reasons.append(_NO_REMOTE[heartbeat.mode])
        elif heartbeat.mode not in CONNECTED_MODES:
            mode = mode_name(heartbeat.mode)
            reasons.append(_STRANGE.filled(mode=mode))
        own = others or now >= self.becomes_own_at or (user and not self._echo)
        return Verdict(True, bool(own), reasons=tuple(reasons))

    def _user_reason(self) -> Coded:
        if self._asked:
            text = f'{self._asked}, then acknowledge on the remote: {_USER}, as this node asks'
            return Coded('fort.estop.asked', text)
        return _NOT_ASKED_NOW if self._echo else _NEVER_ASKED


def _pressed(heartbeat: Heartbeat, bits: int) -> Coded:
    sources = ANYBODY if heartbeat.autonomy is None else ', '.join(estop_sources(bits))
    code = 'any' if heartbeat.autonomy is None else 'unknown'
    for mask, word in ((EStopBits.VSC, 'wired'), (EStopBits.SRC, 'remote')):
        if bits & mask and heartbeat.autonomy is not None:
            code = word
    text = (
        f'release the stop at {sources}, then acknowledge it on the '
        'remote: VSC reports e-stop (SRC: button, or out of reach; VSC: both wired loops)'
    )
    return Coded(f'fort.estop.{code}', text, bits=bits)
