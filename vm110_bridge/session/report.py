"""The words of the base unit's diagnostic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vm110_bridge.protocol import BuState
from vm110_bridge.protocol import Disabled
from vm110_bridge.protocol import LinkStatus
from vm110_bridge.protocol import PeriodicInput
from vm110_bridge.protocol import state_name

_LOW_BATTERY_PERCENT = 20
_LINK_HINTS = {
    LinkStatus.NO_LINK: 'no valid data has been received; check cable and the other end',
    LinkStatus.LINK_ERROR: "a configuration error; compare both ends' configuration",
    LinkStatus.INTERFACE_ERROR: 'reported by the link interface module; check it and its cable',
    LinkStatus.DATA_ERROR: 'the link is up, but what is exchanged is wrong; check the versions '
    'and periodic_output_size',
}
_LINKS_IN_ORDER = (LinkStatus.UNUSED, LinkStatus.OPERATIONAL, LinkStatus.PASSIVE)
_DISABLED_HINTS = {
    Disabled.TILTING: 'disabled due to tilting; hold it upright',
    Disabled.INACTIVITY: 'disabled due to inactivity; enable it again on the remote',
}
UNHEARD = (
    'start what subscribes to ~/command: a command of the remote found no listener, so it is not '
    'acknowledged'
)
LOOPED_BACK = (
    'packets of a machine controller come to the input port; does one use the wrong port?'
)


def summary(vrpi: PeriodicInput | None) -> str:
    """Say how things stand where nothing is wrong."""
    if vrpi is None or vrpi.bu_state != BuState.ARMED:
        return 'ok; no remote is armed, so none moves anything'
    return f'ok; RU {vrpi.armed_ru} is {state_name(vrpi.ru_state).lower()}'


def warnings(vrpi: PeriodicInput) -> list[str]:
    """Say what is not a stop but not right either."""
    texts = [
        f'{name} is {state_name(status)}: {_link_hint(status)}'
        for name, status in _links(vrpi).items()
        if status not in _LINKS_IN_ORDER
    ]
    if vrpi.ru_disabled != Disabled.ENABLED:
        hint = 'disabled for an unknown reason'
        if isinstance(vrpi.ru_disabled, Disabled):
            hint = _DISABLED_HINTS[vrpi.ru_disabled]
        texts.append(f'RU {vrpi.armed_ru} is {hint}')
    if vrpi.armed_ru and vrpi.ru_battery <= _LOW_BATTERY_PERCENT and not vrpi.ru_docked:
        texts.append(f"the remote's battery is at {vrpi.ru_battery} %; dock it or exchange it")
    return texts


def faults(faulty: Sequence[str]) -> list[str]:
    """Name the joysticks that are broken."""
    return [f'the remote reports {", ".join(faulty)}; have it repaired'] if faulty else []


def hold(*, withheld: bool) -> str:
    """Say what becomes of a hold that is asked for."""
    if withheld:
        return 'VRPO are withheld, as hold_output asks or since it is silent'
    return 'hold_output asks, but the relays are open already; VRPO go on for rearming'


def others(origins: Sequence[int], bu_id: int) -> list[str]:
    """Name other base units on the group."""
    if not origins:
        return []
    text = f'another base unit is on this group: {_listed(origins)}, beside ours, {bu_id}'
    return [f'{text}; it is not listened to; give each a port of its own']


def only_others(origins: Sequence[int], bu_id: int) -> str:
    """Say why base units that are heard do not count."""
    return f'base unit {_listed(origins)} is heard, but bu_id is {bu_id}'


def vrpi_values(vrpi: PeriodicInput) -> dict[str, Any]:
    """Return states, links and the armed remote, in the manual's words."""
    values: dict[str, Any] = {
        'BU state': state_name(vrpi.bu_state),
        'VLAPs': vrpi.vlaps,
        'unarmed RUs': vrpi.unarmed_rus,
        **{name: state_name(status) for name, status in _links(vrpi).items()},
        'armed RU': vrpi.armed_ru or 'none',
    }
    if vrpi.armed_ru:
        values |= {
            'RU state': state_name(vrpi.ru_state),
            'RU battery (%)': vrpi.ru_battery,
            'RU C-Link RSSI (%)': vrpi.ru_rssi,
            'RU on cable': vrpi.ru_cable,
            'RU docked': vrpi.ru_docked,
            'RU disabled': state_name(vrpi.ru_disabled) if vrpi.ru_disabled else 'no',
        }
    return values


def _listed(origins: Sequence[int]) -> str:
    return ', '.join(map(str, origins))


def _link_hint(status: LinkStatus | int) -> str:
    return _LINK_HINTS[status] if isinstance(status, LinkStatus) else 'the manual does not know it'


def _links(vrpi: PeriodicInput) -> dict[str, LinkStatus | int]:
    return {'EG-Link': vrpi.eg_link, 'EC-Link': vrpi.ec_link, 'C-Link': vrpi.c_link}
