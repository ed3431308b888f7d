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
    -> Check the EC-Link and EG-Link cables
vm110.ru.stopped: stop, operator: VM-110 remote: has stopped
    release the remote's stop switch, then rearm: the armed remote has stopped …
    -> Release its stop switch
    -> Rearm it
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
    -> Unit restarted? Deactivate and activate the node
    more devices/vm110.md#what-comes-late
vm110.port.closed: stop, technician: VM-110: its port is closed
    check the network interface and interface_address: the port is not open
    -> Check the network interface and interface_address
vm110.cable.no_link: note, technician: VM-110: a link hears nothing
    check cable and the other end, as no valid data has been received: …
    -> Check its cable and the other end
vm110.cable.misfit: note, technician: VM-110: a link is set up otherwise
    compare both ends' configuration: …
    -> Compare the configuration of both ends
vm110.cable.interface: note, technician: VM-110: a link interface fails
    check the link interface module and its cable: …
    -> Check the link interface module and its cable
vm110.cable.data: note, integrator: VM-110: a link carries wrong data
    check the versions and periodic_output_size, as what is exchanged is wrong: …
    -> Check versions and periodic_output_size
vm110.ru.tilted: step, operator: VM-110 remote: tilted
    hold the remote upright: RU … is disabled due to …
    -> Hold it upright
vm110.ru.inactive: step, operator: VM-110 remote: switched itself off
    enable the remote again on itself: RU … is disabled due to …
    -> Enable it again on itself
vm110.battery.low: note, operator: VM-110 remote: battery at {percent} %
    dock or exchange the remote: its battery is at … %
    -> Dock or exchange it
vm110.stick.faulty: stop, technician: VM-110 remote: a joystick is broken
    have the remote repaired: it reports …
    -> Have the remote repaired
vm110.command.unheard: note, integrator: VM-110: nobody takes its commands
    start what subscribes to ~/command: a command of the remote found no listener …
    -> Start what subscribes to ~/command
vm110.hold.deaf: stop, technician: VM-110: its relays stay closed
    find who else sends VRPO to the base unit, or have it repaired: …
    -> Find who else sends VRPO
    -> Have the base unit repaired
vm110.hold.asked: note, operator: VM-110: stopped by this computer
    end what ~/hold_output asks for, then rearm: VRPO are withheld
    -> End what ~/hold_output asks for
    -> Rearm the remote
vm110.hold.silent: note, integrator: VM-110: ~/hold_output is not heard
    start what publishes ~/hold_output: VRPO are withheld, as it is silent, …
    -> Start what publishes ~/hold_output
vm110.hold.open: note, operator: VM-110: it is stopped already
    rearm the remote when the cause of hold_output is gone: the relays are open already …
    -> End the other stops
    -> Rearm the remote
vm110.link.others: note, integrator: VM-110: other base units share its group
    give each base unit a port of its own: … is on this group beside ours …
    -> Give each base unit a port of its own
vm110.link.looped: note, technician: VM-110: a controller sends to its input port
    look for a machine controller that sends to the wrong port: …
    -> Look for a machine controller with a wrong port
""")
