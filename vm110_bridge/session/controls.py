# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The operator's controls, as far as they count: manual sections 4.1.3 to 4.1.5."""

from __future__ import annotations

from bridge_core.session import HeldButtons, StickStream
from vm110_bridge.protocol import BuState, Disabled, MAX_POSITION, PeriodicInput, RuState
from vm110_bridge.session.encoder import Encoder
from vm110_bridge.session.events import EncoderTurned, Sticks
from vm110_bridge.session.settings import Settings

_NEUTRAL = Sticks()
_PUSHED = 1  # bit of a push button with an LED (4.1.5)


class Controls:
    """Sticks, switches and encoder of the remote that is armed."""

    def __init__(self, settings: Settings) -> None:
        self.armed = False
        self.enabled = False
        self._settings = settings
        # The VRPI that says why switches are zero may be the first one that is lost.
        self._held = HeldButtons(2.0 * settings.link_timeout)
        self._stream = StickStream()
        self._encoder = Encoder()
        self._ru = 0  # whose sticks were published last

    def permit(self, vrpi: PeriodicInput | None, *, estop: bool) -> bool:
        """Note whether a remote is armed and enabled (4.1.1, 4.1.3); tell whether that changed."""
        before = self.armed, self.enabled
        self.armed = self.enabled = False
        if vrpi is not None and not estop and vrpi.bu_state == BuState.ARMED and vrpi.armed_ru:
            self.armed = vrpi.ru_state in (RuState.ARMED, RuState.ENABLED)
            is_enabled = vrpi.ru_disabled == Disabled.ENABLED  # both fields have to say so
            self.enabled = is_enabled and vrpi.ru_state == RuState.ENABLED
        return before != (self.armed, self.enabled)

    def lapse(self, now: float, *, link_up: bool, estop: bool) -> list[Sticks]:
        """Return one neutral event if the sticks that were published count no more."""
        if estop:
            self._held.miss(now, stopped=True)
        owed = self._stream.owes_neutral(fresh=link_up, counts=self.enabled)
        if not link_up:
            self._encoder.rest()
        return [_NEUTRAL] if owed else []

    def read(
        self, vrpi: PeriodicInput, now: float, *, estop: bool
    ) -> list[EncoderTurned | Sticks]:
        """Return what a new VRPI says of encoder and sticks."""
        events: list[EncoderTurned | Sticks] = []
        if self._encoder.read(vrpi.encoder, vrpi.armed_ru if self.enabled else 0):
            events.append(EncoderTurned(self._encoder.position))
        sticks = self._sticks_of(vrpi, now, estop)
        self._stream.published(counts=sticks.enabled)
        return [*events, sticks]

    def _sticks_of(self, vrpi: PeriodicInput, now: float, estop: bool) -> Sticks:
        # Another remote's sticks do not go on where those of the one before left off.
        is_known, self._ru = vrpi.armed_ru == self._ru, vrpi.armed_ru
        leds = self._settings.led_switches
        switches = [
            value & _PUSHED if number in leds else value  # a lit LED is no press (4.1.5)
            for number, value in enumerate(vrpi.switches, 1)
        ]
        buttons = (*switches, int(vrpi.encoder_switch))
        if not self.enabled or not is_known:
            # What is held as a remote is found enabled straight after a stop is not hidden: it
            # prevents the mux's reset.
            seen = () if self.enabled and self._held.after_stop else buttons
            self._held.miss(now, stopped=estop, buttons=seen)
            return _NEUTRAL
        if vrpi.faulty and not self._settings.tolerate_faulty_axes:
            self._held.miss(now, stopped=False, buttons=buttons)
            return Sticks(enabled=True, faulty=vrpi.faulty)
        return Sticks(
            axes=tuple(value if abs(value) <= MAX_POSITION else 0 for value in vrpi.joysticks),
            buttons=self._held.of(buttons, now),
            enabled=True,
            faulty=vrpi.faulty,
        )
