# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From pulse inputs to sticks: what is believed, and what it means for a button."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from bridge_core.session import HeldButtons, StickStream
from bridge_core.watchdog import Watchdog
from ssc_bridge.channels import AxisInput, ButtonInput
from ssc_bridge.session.events import Sticks
from ssc_bridge.session.settings import Settings


def neutral(
    settings: Settings, *, faulty: tuple[str, ...] = (), operational: bool = False
) -> Sticks:
    """Return sticks that ask for nothing."""
    axes: tuple[int | None, ...] = (None,) * len(settings.axes)
    return Sticks(axes, (0,) * len(settings.buttons), operational, faulty)


def sticks_of(us: Sequence[int | None], settings: Settings) -> Sticks:
    """
    Return what the pulses ask for; of an axis that is faulty, nothing.

    :param us: of the pulse inputs, input 1 first; None: invalid. The buttons are 0: which of
        ``buttons_of`` count depends on what was held before.
    """
    controls: tuple[AxisInput | ButtonInput, ...] = (*settings.axes, *settings.buttons)
    faults = {control.name: _fault(us, control.channel, settings) for control in controls}
    faulty = tuple(f'{name} {fault}' for name, fault in faults.items() if fault)
    return Sticks(
        axes=tuple(None if faults[axis.name] else us[axis.channel - 1] for axis in settings.axes),
        buttons=(0,) * len(settings.buttons),
        operational=True,
        faulty=faulty,
    )


def buttons_of(us: Sequence[int | None], settings: Settings) -> tuple[int | None, ...]:
    """Return the values of the buttons; None: one that is faulty."""
    return tuple(
        None if _fault(us, button.channel, settings) else button.value(us[button.channel - 1] or 0)
        for button in settings.buttons
    )


def _fault(us: Sequence[int | None], channel: int, settings: Settings) -> str:
    """Say why the pulse of an input is not believed; empty if it is."""
    if channel > len(us):
        return f'absent (there is no pulse input {channel})'
    pulse = us[channel - 1]
    if pulse is None:
        return f'invalid (pulse input {channel})'
    low, high = settings.plausible_us
    return '' if low <= pulse <= high else f'implausible (pulse input {channel}: {pulse} us)'


class PublishedSticks:
    """The sticks as they were published last, and whether they still hold."""

    def __init__(self, settings: Settings) -> None:
        self.heard = Watchdog(settings.link_timeout)  # pulse inputs
        self.faulty: tuple[str, ...] = ()  # controls without a believable pulse
        self._settings = settings
        self._stream = StickStream()
        self._held = HeldButtons(settings.link_timeout)

    def hear(self, us: Sequence[int | None], now: float, *, counts: bool) -> Sticks:
        """Return what to publish of pulse inputs. :param counts: there is no stop."""
        settings = self._settings
        sticks = sticks_of(us, settings) if counts else neutral(settings)
        if sticks.faulty and not settings.tolerate_faulty_axes:
            self._held.miss(now, stopped=False, buttons=buttons_of(us, settings))
            sticks = neutral(settings, faulty=sticks.faulty, operational=True)
        elif counts:
            sticks = replace(sticks, buttons=self._held.of(buttons_of(us, settings), now))
        self.faulty = sticks.faulty
        self._stream.published(counts=counts)
        return sticks

    def lapse(self, now: float, *, link_up: bool, stopped: bool) -> Sticks | None:
        """Return what to publish, once, where the last sticks do not hold any more."""
        if stopped:
            self._held.miss(now, stopped=True)
        fresh = link_up and not self.heard.expired(now)
        if not self._stream.owes_neutral(fresh=fresh, counts=not stopped):
            return None
        self.faulty = ()
        if not stopped:
            self._held.miss(now, stopped=False)
        return neutral(self._settings)

    @property
    def deadline(self) -> float:
        """When sticks that were published become stale; infinite if none were."""
        return self.heard.deadline if self._stream.streaming else math.inf
