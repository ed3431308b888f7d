# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Is it a stop, and whose: manual 6.1, 6.6, 7.3.2 and 7.3.4.

What this node asks of the VSC by its own heartbeat comes back as an E-stop of the VSC. Fed into
another device's chain, that echo would hold both stopped for ever, so it is told apart here.
"""

from __future__ import annotations

import math

from bridge_core.session import Verdict
from fort_vsc_bridge.protocol import CONNECTED_MODES, EStopBits, Heartbeat, MODES_AFTER_A_STOP
from fort_vsc_bridge.session.report import stop_reasons

# The VSC may answer our heartbeat with some delay; 500 ms is its own limit for ours (7.3.4).
ECHO_DELAY = 0.5
OBEY_TIME = 2.0 * ECHO_DELAY  # a VSC that does not stop within this does not hear us


class StopJudge:
    """
    Judges heartbeats of the VSC, knowing what was asked of it.

    :param transition_time: seconds of modes outside table 12 until they are the VSC's own stop:
        one that stands between two others is no demand, and may come with every acknowledgement.
    """

    def __init__(self, transition_time: float) -> None:
        self._transition_time = transition_time
        self._strange_since = math.inf  # modes outside table 12 have come one after the other
        self._asked = ''  # what ends the stop that our heartbeats ask for
        self._echo = False  # USER bits are our doing
        self._echo_heard = False  # they were seen since we asked last
        self._heard_at = self._asked_at = self._released_at = 0.0
        self._before = self._of_asking()

    def asked(self, remedy: str, now: float) -> None:
        """Note what ends the stop that our heartbeat asks for from ``now`` on; empty: none."""
        self._before = self._of_asking()
        if remedy and not self._asked:
            # Bits that stood before, too: while we ask they do not clear, and two devices whose
            # stops ask for each other's would never be clear.
            self._echo = True
            self._echo_heard = False
            self._asked_at = now
        elif self._asked and not remedy:
            self._released_at = now
        self._asked = remedy

    def unasked(self) -> str:
        """
        Take the last one back: our heartbeat did not go out.

        Return what ends the stop that it asked for, if the VSC has not heard of that one at all.
        """
        remedy = self._asked
        self._asked, self._echo, self._echo_heard, self._asked_at, self._released_at = self._before
        return '' if self._asked else remedy

    def _of_asking(self) -> tuple[str, bool, bool, float, float]:
        return self._asked, self._echo, self._echo_heard, self._asked_at, self._released_at

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
        user = bool(heartbeat.estop & EStopBits.USER)
        others = bool(heartbeat.estop & ~int(EStopBits.USER))
        if heartbeat.estop == 0 and heartbeat.mode in CONNECTED_MODES:
            return Verdict()
        own = others or now >= self.becomes_own_at or (user and not self._echo)
        reasons = stop_reasons(heartbeat, asked=self._asked, echo=self._echo)
        return Verdict(True, own, reasons=tuple(reasons))
