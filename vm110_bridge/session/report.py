# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of the base unit's diagnostic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bridge_core.reasons import Coded, passed_on
from bridge_core.watchdog import in_words
from vm110_bridge.protocol import BuState, Disabled, LinkStatus, PeriodicInput, state_name
from vm110_bridge.session.lateness import Lateness

_LOW_BATTERY_PERCENT = 20
_LINKS_TO_DO: dict[int, Coded] = {
    LinkStatus.NO_LINK: Coded(
        'vm110.cable.no_link', 'check cable and the other end, as no valid data has been received'
    ),
    LinkStatus.LINK_ERROR: Coded('vm110.cable.misfit', "compare both ends' configuration"),
    LinkStatus.INTERFACE_ERROR: Coded(
        'vm110.cable.interface', 'check the link interface module and its cable'
    ),
    LinkStatus.DATA_ERROR: Coded(
        'vm110.cable.data',
        'check the versions and periodic_output_size, as what is exchanged is wrong',
    ),
}
_LINKS_IN_ORDER = (LinkStatus.UNUSED, LinkStatus.OPERATIONAL, LinkStatus.PASSIVE)
_DISABLED_TO_DO: dict[int, Coded] = {
    Disabled.TILTING: Coded('vm110.ru.tilted', 'hold the remote upright'),
    Disabled.INACTIVITY: Coded('vm110.ru.inactive', 'enable the remote again on itself'),
}
_UNKNOWN = Coded('vm110.state.unknown', 'check which version of the manual the system follows')
_LATE = Coded(
    'vm110.link.late',
    'look at the network to the base unit: what it says comes {} later than before, '
    'line_age_limit is {}',
)
UNHEARD = Coded(
    'vm110.command.unheard',
    'start what subscribes to ~/command: a command of the remote found no listener, so it is not '
    'acknowledged',
)
DEAF = Coded(
    'vm110.hold.deaf',
    'find who else sends VRPO to the base unit, or have it repaired: its relays stay closed '
    'although VRPO are withheld',
)
LOOPED_BACK = Coded(
    'vm110.link.looped',
    'look for a machine controller that sends to the wrong port: its packets come to the input '
    'port',
)
NO_CAUSE = Coded(
    'vm110.link.silent',
    "check the BU's power, its EG-Link cable, group, input_port and interface_address",
)
RESTARTING = Coded('vm110.link.restarting', 'wait a second, as its serial numbers begin anew')
OTHER_LAYOUT = Coded(
    'vm110.link.other_layout',
    'check which version of the manual the system follows, as packets of another revision or size '
    'come',
)
NO_ORIGIN = Coded(
    'vm110.link.no_origin',
    'give the base unit an ID other than 0, as VRPI of origin 0 come, which is the machine '
    'controller',
)
WRONG_CRC = Coded(
    'vm110.link.wrong_crc',
    'look for what else uses this group and port, as packets with a wrong CRC come',
)


def late(lateness: Lateness) -> Coded:
    """Say how much later than before VRPI come."""
    return _LATE.filled(in_words(lateness.lag), in_words(lateness.limit))


def summary(vrpi: PeriodicInput | None) -> str:
    """Say how things stand where nothing is wrong."""
    if vrpi is None or vrpi.bu_state != BuState.ARMED:
        return 'ok; no remote is armed, so none moves anything'
    return f'ok; RU {vrpi.armed_ru} is {state_name(vrpi.ru_state).lower()}'


def warnings(vrpi: PeriodicInput) -> list[Coded]:
    """Say what is not a stop but not right either."""
    texts = [
        passed_on(to_do, f'{to_do}: {name} is {state_name(status)}')
        for name, status in _links(vrpi).items()
        if status not in _LINKS_IN_ORDER
        for to_do in [_LINKS_TO_DO.get(status, _UNKNOWN)]
    ]
    if vrpi.ru_disabled != Disabled.ENABLED:
        to_do = _DISABLED_TO_DO.get(vrpi.ru_disabled, _UNKNOWN)
        reason = state_name(vrpi.ru_disabled).lower()
        text = f'{to_do}: RU {vrpi.armed_ru} is disabled due to {reason}'
        texts.append(passed_on(to_do, text))
    if vrpi.armed_ru and vrpi.ru_battery <= _LOW_BATTERY_PERCENT and not vrpi.ru_docked:
        text = f'dock or exchange the remote: its battery is at {vrpi.ru_battery} %'
        texts.append(Coded('vm110.battery.low', text, percent=vrpi.ru_battery))
    return texts


def faults(faulty: Sequence[str]) -> list[Coded]:
    """Name the joysticks that are broken."""
    text = f'have the remote repaired: it reports {", ".join(faulty)}'
    return [Coded('vm110.stick.faulty', text)] if faulty else []


def hold(*, withheld: bool, silent: str) -> Coded:
    """Say what becomes of a hold that is asked for. :param silent: for how long; empty: asked."""
    if not withheld:
        return Coded(
            'vm110.hold.open',
            'rearm the remote when the cause of hold_output is gone: the relays are open already, '
            'and VRPO go on',
        )
    if silent:
        text = f'start what publishes ~/hold_output: VRPO are withheld, as it is silent, {silent}'
        return Coded('vm110.hold.silent', text)
    text = 'end what ~/hold_output asks for, then rearm: VRPO are withheld'
    return Coded('vm110.hold.asked', text)


def two_senders(bu_id: int, address: str, second: str) -> Coded:
    """Name two senders with one ID."""
    text = (
        f'stop one of two senders, or name yours in allowed_sources: {address} and {second} both '
        f'send as base unit {bu_id}'
    )
    return Coded('vm110.link.two_senders', text)


def others(origins: Sequence[int], bu_id: int) -> list[Coded]:
    """Name other base units on the group."""
    if not origins:
        return []
    text = (
        f'give each base unit a port of its own: {_listed(origins)} is on this group beside ours, '
        f'{bu_id}, and is not listened to'
    )
    return [Coded('vm110.link.others', text)]


def only_others(origins: Sequence[int], bu_id: int, *, chosen: bool) -> Coded:
    """Say why base units that are heard do not count. :param chosen: ours is a parameter."""
    remedy = 'set bu_id' if chosen else 'deactivate and activate the node'
    text = f"check base unit {bu_id}'s power, or {remedy}, as {_listed(origins)} is heard instead"
    return Coded('vm110.link.other_unit', text)


def other_crc(*, chosen: bool) -> Coded:
    """Say why packets with the other CRC do not count. :param chosen: ours is a parameter."""
    remedy = 'set crc to auto' if chosen else 'deactivate and activate the node'
    return Coded('vm110.link.other_crc', f'{remedy}, as packets with the other CRC come')


def vrpi_values(vrpi: PeriodicInput | None) -> dict[str, Any]:
    """Return states, links and the armed remote, in the manual's words; None: nothing comes."""
    if vrpi is None:
        return {'BU state': 'Not heard'}
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


def _links(vrpi: PeriodicInput) -> dict[str, LinkStatus | int]:
    return {'EG-Link': vrpi.eg_link, 'EC-Link': vrpi.ec_link, 'C-Link': vrpi.c_link}
