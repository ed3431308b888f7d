"""The words of the VSC's diagnostic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bridge_core.session import Level
from fort_vsc_bridge.protocol import CONNECTED_MODES
from fort_vsc_bridge.protocol import estop_sources
from fort_vsc_bridge.protocol import EStopBits
from fort_vsc_bridge.protocol import Heartbeat
from fort_vsc_bridge.protocol import mode_name
from fort_vsc_bridge.protocol import MODES_AFTER_A_STOP
from fort_vsc_bridge.protocol import RemoteStatus

LOOPED_BACK = 'our own frames come back: is RX wired to TX, or echo on?'
_LOW_BATTERY_PERCENT = 20
_WEAK_RADIO = (
    'bring the remote nearer, or its way to the VSC clear of metal: the radio is at its weakest '
    '(strength 0), and the next step is a stop'
)
_NO_REMOTE = (
    'no remote connected, or a stop not acknowledged yet; switch the remote on, bring it into '
    'reach, acknowledge on it'
)
_NOT_WORKING = 'the VSC does not say that it works; restart it, see its LED, check its firmware'


def stop_reasons(heartbeat: Heartbeat, *, asked: str, echo: bool) -> list[str]:
    """
    Return why a heartbeat is a stop, and what to do; empty if no bit is set and a remote there.

    :param asked: why our heartbeats ask for a stop; empty if they do not. :param echo: USER bits
        are our doing.
    """
    reasons = []
    others = heartbeat.estop & ~int(EStopBits.USER)
    if others:
        reasons.append(
            f'VSC reports e-stop: {", ".join(estop_sources(others))}; release it there (SRC: '
            'button, or remote out of reach; VSC: both wired loops), then acknowledge it on the '
            'remote'
        )
    if heartbeat.estop & EStopBits.USER:
        reasons.append(f'VSC reports e-stop: USER (this computer), {_whose(asked, echo)}')
    if heartbeat.mode not in CONNECTED_MODES:
        hint = _NO_REMOTE if heartbeat.mode in MODES_AFTER_A_STOP else _NOT_WORKING
        reasons.append(f'mode is {mode_name(heartbeat.mode)}: {hint}')
    return reasons


def _whose(asked: str, echo: bool) -> str:
    if asked:
        return asked
    if echo:
        return 'not asked any more; acknowledge it on the remote'
    return (
        'not asked by this node; did its heartbeats fail (User E-STOP Timeout), or an earlier '
        'one leave it set? acknowledge it on the remote'
    )


def control_problems(faulty: Sequence[str]) -> list[tuple[Level, str]]:
    """Name the controls that the remote itself calls broken or absent."""
    if not faulty:
        return []
    return [(Level.ERROR, f'the remote reports {", ".join(faulty)}; have it repaired')]


def remote_problems(remote: RemoteStatus | None) -> list[tuple[Level, str]]:
    """Say when the remote's battery has to be charged, and when it is about to be lost."""
    problems: list[tuple[Level, str]] = []
    if remote is None:
        return problems
    battery = remote.battery_percent
    if battery is not None and battery <= _LOW_BATTERY_PERCENT and not remote.charging:
        problems.append((Level.WARN, f"the remote's battery is at {battery} %; charge it"))
    if remote.strength_vsc == 0:
        problems.append((Level.WARN, _WEAK_RADIO))
    return problems


def heartbeat_values(heartbeat: Heartbeat | None) -> dict[str, Any]:
    """Return what the heartbeat says; 'unknown' without a fresh one."""
    return {
        'mode': mode_name(heartbeat.mode if heartbeat else None),
        'e-stop indication': f'0x{heartbeat.estop:08X}' if heartbeat else 'unknown',
        'autonomy mode': mode_name(heartbeat.autonomy) if heartbeat else 'unknown',
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


def refused_software_estop(transport: str) -> str:
    """Say that somebody relies on a stop that this transport cannot carry."""
    return (
        f'transport {transport} cannot carry software_estop, but it comes: the VSC does not stop; '
        'wire that stop elsewhere'
    )
