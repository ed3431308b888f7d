# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What base unit, remote and link say, by code; see ``bridge_core.reasons``."""

from bridge_core.reasons import entries

REASONS = entries("""
vm110.bu.initial: stop, operator: VM-110: the base unit starts
    wait until the base unit has started, then arm a remote: …
    -> Wait, then arm a remote
    more devices/vm110.md#what-is-a-stop
vm110.bu.blocked: stop, operator: VM-110: no remote is armed
    turn on the remote and rearm: …
    -> Turn on the remote
    -> Rearm it
vm110.bu.failed: stop, technician: VM-110: the base unit has failed
    switch the base unit off and on, else have it repaired: …
    -> Switch it off and on
    -> Have it repaired
vm110.bu.stopped: stop, operator: VM-110 remote: stop switch pressed
    release the stop switch on the remote, then rearm: BU state is …
    -> Release the stop switch
    -> Rearm the remote
vm110.bu.external: stop, technician: VM-110: an external link is open
    check the EC-Link and EG-Link cables, then rearm: …
    -> Check the EC-Link and EG-Link cables
    -> Rearm the remote
vm110.bu.missed: stop, operator: VM-110: this node was not heard
    rearm the remote; if it comes back …
    -> Rearm the remote
    -> If it comes back, check the EC-Link and EG-Link cables
vm110.ru.stopped: stop, operator: VM-110 remote: has stopped
    release the remote's stop switch, then rearm: the armed remote has stopped …
    -> Release its stop switch
    -> Rearm it; free fall, shock and fatal errors stop it, too
vm110.state.unknown: stop, integrator: VM-110: a state that the manual does not know
    check which version of the manual the system follows: RU state is …
    -> Compare the version of the manual
vm110.hold.echo: echo, operator: VM-110: stopped by this computer
    rearm the remote when the cause of hold_output is gone …
    … BU state is External link error, still from hold_output …
    -> End the other stops
    -> Rearm the remote
vm110.link.silent: stop, technician: VM-110: nothing comes
    check the BU's power …; no VRPI from the BU
    -> Check the base unit's power
    -> Check EG-Link cable, group and interface_address
    -> A firewall? rugged_teleop doctor as root
vm110.link.restarting: stop, nobody: VM-110: the base unit was restarted
    wait a second, as its serial numbers begin anew
    -> Wait a second
vm110.link.other_crc: stop, integrator: VM-110: packets have the other CRC
    set crc to auto …
    deactivate and activate the node, as packets with the other CRC come
    -> Set crc to auto
    -> Was it auto? Deactivate and activate the node
vm110.link.other_layout: stop, integrator: VM-110: another revision comes
    check which version of the manual the system follows, as packets of another revision or
        size come
    -> Compare the version of the manual with revision 3
vm110.link.no_origin: stop, technician: VM-110: its ID is 0
    give the base unit an ID other than 0, as VRPI of origin 0 come
    -> Give the base unit another ID
vm110.link.wrong_crc: stop, technician: VM-110: packets with a wrong CRC come
    look for what else uses this group and port, as packets with a wrong CRC come
    -> Look for what else uses this group and port
vm110.link.other_unit: stop, integrator: VM-110: another base unit is heard
    check base unit …'s power, or set bu_id, as … is heard instead
    … or deactivate and activate the node, as … is heard instead
    -> Check the power of this base unit
    -> Exchanged? Set bu_id, or deactivate and activate the node
vm110.link.two_senders: stop, integrator: VM-110: two senders have one ID
    stop one of two senders, or name yours in allowed_sources: …
    -> Stop one, such as a simulator left running
    -> Name yours in allowed_sources
    more decisions/0026-one-identity-one-sender.md
vm110.link.late: stop, technician: VM-110: its packets come late
    look at the network to the base unit: what it says comes … later than before …
    -> Look at the network to the base unit
    more devices/vm110.md#what-comes-late
vm110.port.closed: stop, technician: VM-110: its port is closed
    check the network interface and interface_address: the port is not open
    -> Check the network interface and interface_address
""")
