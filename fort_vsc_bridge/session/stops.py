"""
Is it a stop, and whose: manual 6.1, 6.6, 7.3.2 and 7.3.4.

What this node asks of the VSC by its own heartbeat comes back as an E-stop of the VSC. Fed into
another device's chain, that echo would hold both stopped for ever, so it is told apart here.
"""

from __future__ import annotations

from bridge_core.session import Verdict
from fort_vsc_bridge.protocol import estop_sources
from fort_vsc_bridge.protocol import EStopBits
from fort_vsc_bridge.protocol import Heartbeat
from fort_vsc_bridge.protocol import Mode
from fort_vsc_bridge.protocol import mode_name

CONNECTED_MODES = frozenset((Mode.REMOTE, Mode.OPERATIONAL, Mode.MENU, Mode.PAUSE))
# What the VSC goes back to after every stop, ours too (6.6), so no demand of its own.
_MODES_AFTER_A_STOP = frozenset((Mode.LOCAL, Mode.SEARCHING))
# The VSC may answer our heartbeat with some delay; 500 ms is its own limit for ours (7.3.4).
ECHO_DELAY = 0.5


class StopJudge:
    """Judges heartbeats of the VSC, knowing what was asked of it."""

    def __init__(self) -> None:
        self._asked = False  # our heartbeats say stop
        self._echo = False  # USER bits are our doing
        self._echo_heard = False  # they were seen since we asked last
        self._foreign = False  # USER bits stood before we asked
        self._released_at = 0.0

    def asked(self, stop: bool, now: float) -> None:
        """Note what our heartbeat to the VSC says from ``now`` on."""
        if stop and not self._asked:
            self._echo = self._echo or not self._foreign
            self._echo_heard = False
        elif self._asked and not stop:
            self._released_at = now
        self._asked = stop

    def judge(self, heartbeat: Heartbeat, now: float) -> Verdict:
        """Return what this heartbeat means."""
        user = bool(heartbeat.estop & EStopBits.USER)
        self._follow_echo(user, now)
        strange = heartbeat.mode not in CONNECTED_MODES | _MODES_AFTER_A_STOP
        others = bool(heartbeat.estop & ~int(EStopBits.USER))
        own = others or strange or (user and not self._echo)
        estop = heartbeat.estop != 0 or heartbeat.mode not in CONNECTED_MODES
        return Verdict(estop, own, tuple(self._reasons(heartbeat)) if estop else ())

    def _follow_echo(self, user: bool, now: float) -> None:
        """Keep USER bits ours until they are seen clear: the VSC may hold them for a while."""
        if user:
            self._echo_heard = self._echo_heard or self._echo
            self._foreign = not self._echo
            return
        self._foreign = False
        if self._asked:
            self._echo = True
        elif self._echo_heard or now - self._released_at >= ECHO_DELAY:
            self._echo = False

    def _reasons(self, heartbeat: Heartbeat) -> list[str]:
        reasons = []
        if heartbeat.estop & ~int(EStopBits.USER):
            sources = ', '.join(estop_sources(heartbeat.estop & ~int(EStopBits.USER)))
            reasons.append(
                f'VSC reports e-stop: {sources}; release it there (SRC: button, or remote out of '
                'reach; VSC: both wired loops), then acknowledge it on the remote'
            )
        if heartbeat.estop & EStopBits.USER:
            reasons.append(f'VSC reports e-stop: USER (this computer), {self._whose()}')
        if heartbeat.mode not in CONNECTED_MODES:
            reasons.append(f'mode is {mode_name(heartbeat.mode)}: {_hint(heartbeat.mode)}')
        return reasons

    def _whose(self) -> str:
        if self._asked:
            return 'as software_estop asks; it goes when the cause of that is gone'
        if self._echo:
            return 'not asked any more; acknowledge it on the remote'
        return (
            'not asked by this node; did its heartbeats fail (User E-STOP Timeout), or an earlier '
            'one leave it set? acknowledge it on the remote'
        )


def _hint(mode: Mode | int) -> str:
    if mode in _MODES_AFTER_A_STOP:
        return (
            'no remote connected, or a stop not acknowledged yet; switch the remote on, bring it '
            'into reach, acknowledge on it'
        )
    return 'the VSC does not say that it works; restart it, see its LED, check its firmware'
