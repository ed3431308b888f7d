# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of the VSC's diagnostic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from bridge_core.reasons import Coded
from bridge_core.session import Level
from bridge_core.watchdog import in_words
from fort_vsc_bridge.protocol.messages import Heartbeat, RemoteStatus
from fort_vsc_bridge.protocol.values import CONNECTED_MODES, estop_sources, Mode, mode_name
from fort_vsc_bridge.session.device import OVERRULED, REFUSED, UNANSWERED
from fort_vsc_bridge.session.line_age import LineAge
from fort_vsc_bridge.session.stops import ANYBODY

TWO_VSCS = Coded(
    'fort.link.two_vscs',
    'take one of two VSCs off this bus, or change its identifiers; else set vsc_heartbeat_rate: '
    'heartbeats come more often than one VSC sends them',
)
LOOPED_BACK = Coded(
    'fort.link.looped', 'look for RX wired to TX, or an echo on the line: our own frames come back'
)
DEAF = Coded(
    'fort.link.deaf',
    'check the line from this computer to the VSC (its serial RX), then press a wired stop: it is '
    'asked to stop, and does not',
)
_LATE = Coded(
    'fort.line.late',
    'look at the network to the serial server: what comes over this line is up to {} old, '
    'line_age_limit is {}',
)
_SLOW = Coded(
    'fort.line.slow',
    'look at the network to the serial server: the VSC answers after {}, line_age_limit is {}',
)
UNBOUNDED = Coded(
    'fort.line.unbounded',
    'set line_age_limit: this line goes over a network, and nobody knows how old what comes is',
)
UNANSWERED_AGE = Coded(
    'fort.line.no_answer',
    "look at the VSC's firmware, or join it by USB, RS232 or CAN: it does not answer the question "
    'for key 85, so nobody knows how old what comes over this network is',
)
_LOW_BATTERY_PERCENT = 20
_BATTERY = Coded('fort.battery.low', 'charge the remote: its battery is at {percent} %')
_STATUS_TIME = 5.0  # s with a remote and without a remote status message that are no accident
_WEAK_RADIO = Coded(
    'fort.radio.weak',
    'bring the remote nearer, or its way to the VSC clear of metal: the radio is at its weakest '
    '(strength 0), and the next step is a stop',
)
_QUIET: dict[
    Mode | int, Coded
] = {  # why sticks are zeroed without a stop, and what ends it (6.2 to 6.4)
    Mode.REMOTE: Coded(
        'fort.remote.not_operational',
        'bring the remote into Operational mode: it is in Remote mode, where its sticks '
        'are 0 until its operator is ready',
    ),
    Mode.MENU: Coded(
        'fort.remote.menu',
        'leave the menu of the remote: it is in Menu mode, where its sticks are 0',
    ),
    Mode.PAUSE: Coded(
        'fort.remote.paused',
        'take the remote in hand, hold it upright and leave Pause mode on it: its Pause '
        'button, its orientation, a free fall or inactivity has paused it, so its sticks are 0',
    ),
}
_SETTINGS_TO_DO = {
    REFUSED: ('refused', "see the VSC's firmware and the maker's tool"),
    UNANSWERED: ('unanswered', 'connect a remote, and see that the VSC hears this computer'),
    OVERRULED: ('overruled', 'change the parameter, or what ~/set_user_value says'),
}


def quiet_because(heartbeat: Heartbeat | None) -> list[Coded]:
    """Return why the sticks are zeroed though nothing is a stop, and what ends it."""
    text = _QUIET.get(heartbeat.mode) if heartbeat and not heartbeat.estop else None
    return [text] if text else []


def device_state(
    heartbeat: Heartbeat | None, remote: RemoteStatus | None
) -> tuple[Level, str, dict[str, Any]]:
    """Return what the VSC says of itself and its remote: a level, words, and values."""
    if heartbeat is None:
        return Level.ERROR, 'None: no heartbeat from the VSC', heartbeat_values(None)
    mode, sources = mode_name(heartbeat.mode), ', '.join(estop_sources(heartbeat.estop)) or 'none'
    if heartbeat.autonomy is None and heartbeat.estop:
        sources = ANYBODY
    message = '; '.join([mode, *quiet_because(heartbeat)])
    if heartbeat.estop:
        message = f'{mode}; e-stop: {sources}'
    clear = heartbeat.mode in CONNECTED_MODES and not heartbeat.estop
    values = {
        **heartbeat_values(heartbeat),
        'e-stop sources': sources,
        'remote connected': heartbeat.mode in CONNECTED_MODES,
        **remote_values(remote),
    }
    return Level.OK if clear else Level.WARN, message, values


def remote_status_state(remote: RemoteStatus | None, connected_for: float, to_do: str) -> str:
    """
    Say whether the remote status message comes, which is off as delivered (table 17).

    :param connected_for: seconds for which a remote is connected. :param to_do: if it does not.
    """
    if remote is not None:
        return 'comes'
    if connected_for < _STATUS_TIME:
        return 'not known yet'
    return f'{to_do}: none comes, so ~/battery and ~/radio_strength are unknown'


def remote_problems(remote: RemoteStatus | None) -> list[tuple[Level, Coded]]:
    """Say when the remote's battery has to be charged, and when it is about to be lost."""
    problems: list[tuple[Level, Coded]] = []
    if remote is None:
        return problems
    battery = remote.battery_percent
    if battery is not None and battery <= _LOW_BATTERY_PERCENT and not remote.charging:
        problems.append((Level.WARN, _BATTERY.filled(percent=battery)))
    if remote.strength_vsc == 0:
        problems.append((Level.WARN, _WEAK_RADIO))
    return problems


def setting_problems(
    states: Mapping[str, str], passed_over: Sequence[str]
) -> list[tuple[Level, Coded]]:
    """
    Name the settings of the device that are wanted and not in force.

    :param states: by name. :param passed_over: parameters that are given, but not written.
    """
    problems: list[tuple[Level, Coded]] = []
    for name, state in states.items():
        if state in _SETTINGS_TO_DO:
            word, to_do = _SETTINGS_TO_DO[state]
            text = f'{to_do}: device.{name}: {state}'
            problems.append((Level.WARN, Coded(f'fort.setting.{word}', text, name=name)))
    if passed_over:
        names = ', '.join(passed_over)
        text = f'set configure_device, or leave {names} out: nothing is written while it is false'
        problems.append((Level.WARN, Coded('fort.setting.not_written', text, names=names)))
    return problems


def late(line: LineAge, now: float) -> Coded:
    """Say how old what comes over the line may be."""
    return _LATE.filled(in_words(now - line.as_of), in_words(line.limit))


def line_problems(line: LineAge | None, *, queues: bool) -> list[tuple[Level, Coded]]:
    """Say what is not known of the age of what comes, or is more than half of its limit."""
    if not queues:
        return []
    if line is None:
        return [(Level.WARN, UNBOUNDED)]
    if line.is_silent:
        return [(Level.WARN, UNANSWERED_AGE)]
    if math.isfinite(line.trip) and line.trip >= line.limit / 2:
        return [(Level.WARN, _SLOW.filled(in_words(line.trip), in_words(line.limit)))]
    return []


def line_values(line: LineAge | None, now: float) -> dict[str, Any]:
    """Return how old what comes may be; nothing where the line holds nothing back."""
    if line is None:
        return {}
    age, trip = (
        each if math.isfinite(each) else 'not known' for each in (now - line.as_of, line.trip)
    )
    return {'age of the line, at most (s)': age, 'answer of the VSC after (s)': trip}


def heartbeat_values(heartbeat: Heartbeat | None) -> dict[str, Any]:
    """Return what the heartbeat says; without a fresh one mode 'None', all else 'unknown'."""
    if heartbeat is None:
        return {'mode': 'None', 'e-stop indication': 'unknown', 'autonomy mode': 'unknown'}
    indication = f'0x{heartbeat.estop:08X}'
    if heartbeat.autonomy is None:  # HID, which has one byte for all
        indication = 'actuated' if heartbeat.estop else 'not actuated'
    return {
        'mode': mode_name(heartbeat.mode),
        'e-stop indication': indication,
        'autonomy mode': mode_name(heartbeat.autonomy),
    }


def remote_values(remote: RemoteStatus | None) -> dict[str, Any]:
    """Return battery and radio of the remote; nothing where nothing is known of them."""
    if remote is None:
        return {}
    return {
        'battery (%)': 'unknown' if remote.battery_percent is None else remote.battery_percent,
        'charging': remote.charging,
        'strength at VSC (0 low to 2 high)': remote.strength_vsc,
        'strength at remote (0 low to 2 high)': remote.strength_src,
        'reserved bytes (RSSI on some)': remote.reserved.hex(' '),
    }
