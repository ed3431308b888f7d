# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the arbiter remembers of resets and trips: which call counts, and what a trip asks for."""

from bridge_core.reasons import Coded
from safety_mux.protocol import milliseconds, Reply
from safety_mux.settings import MuxConfig


class ResetCalls:
    """
    The calls of ~/reset. Each counts once, and none is queued.

    A call within ``clear_time`` of another is a held or repeated one. Calls that go on while there
    is nothing to reset are those of a script: after a stop none counts until there was none for
    ``reset_silence``.
    """

    def __init__(self, config: MuxConfig) -> None:
        self._config = config
        self.last: float | None = None
        self.go_on = False  # they began when there was nothing to reset

    def continue_from(self, before: 'ResetCalls') -> None:
        """Remember what another one does."""
        self.last, self.go_on = before.last, before.go_on

    def refusal(self, now: float, late: str, *, stopped: bool) -> str:
        """
        Record a call; return why it does not count, empty if it does.

        :param late: why it may be one of long ago. It does not count then, but breaks no line of
            calls that go on.
        """
        script, before = self.script(now), self.last
        go_on = not stopped or bool(script) or bool(late and self.go_on)
        if go_on or not late:
            self.last, self.go_on = now, go_on
        if script or late or before is None or now - before >= self._config.clear_time:
            return script or late
        return (
            'a held or repeated reset does nothing, this one came '
            f'{milliseconds(now - before)} after another; wait for '
            f'{milliseconds(self._config.clear_time)}, then call ~/reset once'
        )

    def script(self, now: float) -> Coded | None:
        """Say how much of ``reset_silence`` is missing; None if nothing is."""
        if self.last is None or not self.go_on:
            return None
        silent, limit = now - self.last, self._config.reset_silence
        if silent >= limit:
            return None
        text = (
            'resets have been called since before the stop, so none counts until there was none '
            f'for {milliseconds(limit)}; the last was {milliseconds(silent)} ago'
        )
        return Coded('mux.reset.script', text, silent_s=silent, limit_s=limit)


class Trip:
    """
    A trip, which is like a button: all devices are asked to stop until it ends.

    ``since``: when it began; None: none is active. ``new``: its reason, until the next tick.
    """

    def __init__(self, config: MuxConfig) -> None:
        self._least = config.clear_time
        self.since: float | None = None
        self.new: Coded | None = None

    def begin(self, now: float) -> None:
        """Begin, or begin again."""
        self.since, self.new = now, Coded('mux.trip.called', '~/trip was called')

    def may_end(self, now: float) -> bool:
        """Return whether one is active and has lasted for ``clear_time``."""
        return self.since is not None and now - self.since >= self._least

    def end(self, now: float) -> Reply:
        """End it if it may."""
        if self.since is None:
            return Reply(False, 'no trip is active')
        if not self.may_end(now):
            return Reply(False, f'not ended: a trip lasts {milliseconds(self._least)} or longer')
        self.since = None
        return Reply(True, 'the trip is ended; call ~/reset when all devices are clear')
