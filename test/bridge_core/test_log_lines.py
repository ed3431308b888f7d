# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a device can make a node log as often as it likes has a site: at most a line a second."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from akron_can_bridge.node import AkronCanBridge
from akron_can_bridge.session import FaultsChanged, UnitChanged
from ssc_bridge.node import SscBridge
from ssc_bridge.protocol import Configuration
from ssc_bridge.session import ConfigurationRead


def test_units_faults_and_configurations_have_a_site() -> None:
    sites: list[str] = []
    node = SimpleNamespace(log=lambda level, text, site='': sites.append(site))
    node._log_faults = lambda event: AkronCanBridge._log_faults(cast(Any, node), event)
    akron: list[Any] = [
        FaultsChanged(('motor axis 1',)),
        FaultsChanged(()),
        UnitChanged('unit 1032AE100801035 is at address 80', '1032AE100801035', 1032),
    ]
    for event in akron:
        AkronCanBridge.on_event(cast(Any, node), event)
    read = ConfigurationRead(Configuration.from_payload(bytes((126, 8)) + bytes(12)))
    SscBridge._log_configuration(cast(Any, node), read)
    assert sites == ['faults', 'faults', 'unit', 'configuration']
