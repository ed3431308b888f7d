# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the joints really do: whether they stand, and whether they move as nobody asked them to.

A part of the arbiter, which passes on what was measured and, in each tick, what was commanded.
What is not known counts as motion where standstill is asked for, and never as overspeed.
"""

import math

from bridge_core.reasons import Coded
from safety_mux.inputs import Input
from safety_mux.protocol import Demand, milliseconds
from safety_mux.settings import Feedback


class FeedbackInput(Input):
    """
    The measured speeds of all joints.

    ``fault``: in words, motion that nobody asked for. It lasts until the joints stand.

    :param stop_time: seconds within which the joints stand after ``told_to_stand``.
    :param age_limit: as of Input, where a drive that proves ages measures them.
    """

    KIND = 'feedback'

    def __init__(self, config: Feedback, stop_time: float, *, age_limit: float = math.inf) -> None:
        super().__init__('the feedback', config.timeout, age_limit=age_limit)
        self.config = config
        self.stop_time = stop_time
        self._unknown: Demand = (math.inf,) * len(config.joints)
        self.speeds = self._unknown
        self._at_zero = False  # the speeds were heard since the command became 0
        self._zero_at = -math.inf  # when it did
        self.fault: Coded | None = None
        self._told_at: float | None = None  # set: they are on their way to standstill
        self._fast_since: dict[str, float] = {}  # by joint

    def measured(self, speeds: Demand, now: float) -> None:
        """Record a good message; rad/s, one number a joint."""
        self.well_formed(now)
        self.speeds = speeds
        self._at_zero = True

    @property
    def use(self) -> str:
        """``standing`` or ``moving``."""
        return 'standing' if self._slow else 'moving'

    @property
    def _slow(self) -> bool:
        return max(map(abs, self.speeds)) <= self.config.standstill

    @property
    def awaited(self) -> bool:
        """Whether control has ended, and the joints were not seen to stand since."""
        return self._told_at is not None

    @property
    def _is_news(self) -> bool:
        """Whether the speeds were measured since the command became 0, as far as is proven."""
        return self._at_zero and self.is_since(self._zero_at)

    def standing(self, now: float) -> bool:
        """Return whether all joints stand, measured since the command became 0."""
        return self._slow and self._is_news and self.usable(now)

    def left(self, now: float) -> str:
        """Return in words what is left of the motion."""
        problem = self.problem(now)
        if problem is None and (
            self.speeds == self._unknown or (self._slow and not self._is_news)
        ):
            return 'not measured since'
        return problem or f'left at {max(map(abs, self.speeds)):.1f} rad/s'

    def told_to_stand(self, now: float) -> None:
        """
        Note that control has ended: they have to be seen to stand within ``stop_time``.

        Told again meanwhile, as control begins and ends anew, they have no more time.
        """
        if self._told_at is None:
            self._told_at = now
            self.speeds = self._unknown  # what was measured before says nothing of it

    def continue_from(self, before: 'FeedbackInput') -> None:
        """Wait for the standstill that the one before, of the same joints, has not seen."""
        self.fault, self._told_at = before.fault, before._told_at
        self._zero_at = before._zero_at

    def judge(self, commanded: Demand, now: float) -> None:
        """Compare what was measured with what is commanded; call it once a tick or more often."""
        if any(commanded):
            self._at_zero, self._zero_at = False, now
        if self.standing(now):
            self.fault = self._told_at = None
            self._fast_since.clear()
        elif self._told_at is not None:
            if not 0.0 <= now - self._told_at < self.stop_time:
                limit = milliseconds(self.stop_time)
                text = f'the joints do not stand {limit} after control: {self.left(now)}'
                self.fault = Coded('mux.motion.unstopped', text, limit_s=self.stop_time)
                self._told_at = None
        elif self.fault is None:
            self._look_for_overspeed(commanded, now)

    def _look_for_overspeed(self, commanded: Demand, now: float) -> None:
        if not self.usable(now):
            self._fast_since.clear()
            return
        for joint, speed, asked in zip(self.config.joints, self.speeds, commanded, strict=True):
            beyond = max(speed - max(asked, 0.0), min(asked, 0.0) - speed)
            margin = self.config.overspeed_tolerance
            if not beyond > (margin if asked else margin + self.config.standstill):
                self._fast_since.pop(joint, None)
                continue
            since = self._fast_since.setdefault(joint, now)
            if not 0.0 <= now - since < self.config.overspeed_time:
                text = f"joint '{joint}' runs at {speed:.1f} rad/s, asked for {asked:.1f}"
                fields = {'speed_rad_s': speed, 'asked_rad_s': asked}
                self.fault = Coded('mux.motion.overspeed', text, joint=joint, **fields)
