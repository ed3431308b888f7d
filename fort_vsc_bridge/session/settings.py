# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session needs to know, checked, and what the device is to be set to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from bridge_core.settings import CheckedSettings, table_of
from fort_vsc_bridge.parameters import LEAVE, PARAMETERS
from fort_vsc_bridge.protocol.can import CanIds
from fort_vsc_bridge.protocol.frames import MessageType
from fort_vsc_bridge.protocol.wires import CanWire, HidWire, SerialWire, Wire

_TABLE = table_of(PARAMETERS)
_DEVICE = 'device.'


@dataclass(frozen=True, kw_only=True)
class DeviceSettings(CheckedSettings):
    """What the device is to be set to: the parameters ``device.*``; -1 leaves as it is."""

    TABLE = {
        name.removeprefix(_DEVICE): parameter
        for name, parameter in _TABLE.items()
        if name.startswith(_DEVICE)
    }
    inactivity_pause_minutes: int = LEAVE
    auto_off_enable: int = LEAVE
    orientation_pause_enable: int = LEAVE
    free_fall_pause_enable: int = LEAVE
    inactivity_pause_enable: int = LEAVE
    user_estop_timeout: int = LEAVE
    joystick_interval_ms: int = LEAVE
    heartbeat_interval_ms: int = LEAVE
    gps_interval_ms: int = LEAVE
    remote_status_interval_ms: int = LEAVE

    @property
    def wanted(self) -> dict[str, int]:
        """The settings that are not to be left alone, by name."""
        return {name: value for name, value in asdict(self).items() if value != LEAVE}


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedSettings):
    """
    What a session needs to know; the fields without comment are parameters.

    :param wire: how the VSC is joined.
    :param device: what to set in the device if ``configure_device``.
    :raises ValueError: for what cannot be, or would make the link seem lost.
    """

    TABLE = _TABLE
    wire: Wire = field(default_factory=SerialWire)
    device: DeviceSettings = field(default_factory=DeviceSettings)
    link_timeout: float = _TABLE['link_timeout'].default
    line_age_limit: float = _TABLE['line_age_limit'].default
    transition_time: float = _TABLE['transition_time'].default
    heartbeat_rate: float = _TABLE['heartbeat_rate'].default
    software_estop_timeout: float = _TABLE['software_estop_timeout'].default
    require_software_estop: bool = _TABLE['require_software_estop'].default
    tolerate_faulty_axes: bool = _TABLE['tolerate_faulty_axes'].default
    configure_device: bool = _TABLE['configure_device'].default
    read_identity: bool = _TABLE['read_identity'].default
    show_status: str = _TABLE['show_status'].default

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.link_timeout <= self.wire.INTERVAL:
            raise ValueError(
                f'link_timeout = {self.link_timeout}: allowed is above {self.wire.INTERVAL} s '
                f'with transport {self.wire.NAME}, which gives no sooner sign of life'
            )
        if self.require_software_estop and not self.wire.carries(MessageType.HOST_HEARTBEAT):
            raise ValueError(
                f'require_software_estop = True: transport {self.wire.NAME} cannot carry '
                'software_estop; wire that stop elsewhere'
            )
        if self.configure_device and not self.wire.PERIODS:
            raise ValueError(
                f'configure_device = True: transport {self.wire.NAME} can write nothing'
            )
        if self.read_identity and not self.wire.carries(MessageType.SETUP_UNLOCK):
            raise ValueError(f'read_identity = True: transport {self.wire.NAME} cannot ask for it')
        if self.show_status and not self.wire.carries(MessageType.USER_FEEDBACK_NAME):
            raise ValueError(
                f'show_status = {self.show_status!r}: transport {self.wire.NAME} cannot show it'
            )
        for name in ('joystick_interval_ms', 'heartbeat_interval_ms'):
            interval = getattr(self.device, name)
            if 2e-3 * interval > self.link_timeout:  # one missing message must not be a stop
                limit = f'half of link_timeout ({self.link_timeout} s)'
                raise ValueError(f'{_DEVICE}{name} must not be above {limit}, but is {interval}')
        if self.to_configure and not self.wire.carries(MessageType.USER_FEEDBACK_GET):
            name = next(iter(self.to_configure))  # it would have to be written blindly
            raise ValueError(
                f'{_DEVICE}{name}: transport {self.wire.NAME} cannot read it; set it over serial'
            )

    @property
    def to_configure(self) -> dict[str, int]:
        """What the device is to be set to, by name."""
        return self.device.wanted if self.configure_device else {}

    @property
    def passed_over(self) -> list[str]:
        """The parameters ``device.*`` that are given, but not written. CAN and HID never do."""
        readable = self.wire.carries(MessageType.USER_FEEDBACK_GET)
        wanted = self.device.wanted if readable and not self.configure_device else {}
        return [_DEVICE + name for name in wanted]

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Settings:
        """Return what the parameters say. :raises ValueError: what cannot be."""
        device = {name: values[_DEVICE + name] for name in DeviceSettings.TABLE}
        return cls(wire=wire_of(values), device=DeviceSettings(**device), **cls.named(values))


def wire_of(values: Mapping[str, Any]) -> Wire:
    """Return the wire that ``transport`` names. :raises ValueError: it cannot be made."""
    if values['transport'] == 'hid':
        return HidWire()
    if values['transport'] == 'serial':
        return SerialWire(network='://' in values['port'])
    try:
        ids = CanIds(**{name: values[f'can.{name}'] for name in CanIds().by_name})
        return CanWire(ids, values['vsc_heartbeat_rate'])
    except ValueError as error:
        raise ValueError(f'can.{error}') from error
