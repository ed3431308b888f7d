# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How many mutants of each file may survive, and why nobody could see the difference.

``make mutants`` fails where more of a file survive, and shows all its survivors then. Where a
whole run finds fewer, it says so, and the number here is to be lowered. Who adds to a number has
looked at the mutant: either it is one of these kinds, or a test is missing.
"""

UNREAD = 'what it changes is set anew, or hidden, before anybody reads it'
IMPLIED = 'what is left of the condition, or what was decided before, implies it'
SAME = 'the other value or comparison gives the same result'
FALSY = 'None is as false as the value'
ABSTRACT = 'each subclass has its own'
AGAIN = 'the step that follows does the same'
ANY = 'it is any number of about that size, sign or bit'
MOMENT = 'at just that moment either will do'
PROCESSES = 'only tests with real processes read it'

EXCUSED: dict[str, dict[str, int]] = {
    'akron_can_bridge/convert.py': {SAME: 1, IMPLIED: 1, ANY: 1},
    'akron_can_bridge/protocol/broadcasts.py': {ANY: 1},
    'akron_can_bridge/protocol/fields.py': {ANY: 1},
    'akron_can_bridge/protocol/frames.py': {IMPLIED: 1, ABSTRACT: 1, SAME: 1},
    'akron_can_bridge/protocol/values.py': {ANY: 1},
    'akron_can_bridge/session/asker.py': {FALSY: 1},
    'akron_can_bridge/session/drive.py': {UNREAD: 2},
    'akron_can_bridge/session/finder.py': {UNREAD: 5, FALSY: 4, IMPLIED: 4, MOMENT: 1},
    'akron_can_bridge/session/joysticks.py': {UNREAD: 1, IMPLIED: 3},
    'akron_can_bridge/session/motion.py': {UNREAD: 4},
    'akron_can_bridge/session/report.py': {IMPLIED: 1},
    'akron_can_bridge/session/session.py': {IMPLIED: 2, AGAIN: 5, UNREAD: 3, FALSY: 1},
    'akron_can_bridge/session/settings.py': {IMPLIED: 1, ANY: 2},
    'akron_can_bridge/session/stops.py': {FALSY: 3},
    'akron_can_bridge/session/unit.py': {FALSY: 1, AGAIN: 1, ANY: 1, IMPLIED: 1},
    'bridge_core/actuator.py': {ABSTRACT: 1, AGAIN: 1, MOMENT: 1},
    'bridge_core/checksums.py': {SAME: 2, IMPLIED: 1},
    'bridge_core/framing.py': {ABSTRACT: 1, SAME: 1, FALSY: 1, ANY: 1},
    'bridge_core/gate.py': {UNREAD: 4, IMPLIED: 3},
    'bridge_core/lane.py': {IMPLIED: 1, FALSY: 1, ANY: 2},
    'bridge_core/mux_words.py': {ANY: 3, UNREAD: 1, AGAIN: 3, MOMENT: 2},
    'bridge_core/packets.py': {IMPLIED: 1},
    'bridge_core/proof.py': {ANY: 4, SAME: 4, FALSY: 2, UNREAD: 2, IMPLIED: 1},
    'bridge_core/publishers.py': {IMPLIED: 1},
    'bridge_core/rclpy_inner.py': {FALSY: 3, ANY: 13, AGAIN: 2},
    'bridge_core/session.py': {IMPLIED: 1, UNREAD: 4, FALSY: 1, AGAIN: 2},
    'bridge_core/supervisor.py': {UNREAD: 2, ANY: 5, MOMENT: 4, IMPLIED: 4},
    'bridge_core/transports/active.py': {MOMENT: 1, AGAIN: 1, FALSY: 1},
    'bridge_core/transports/child.py': {ANY: 2, FALSY: 1, IMPLIED: 1},
    'bridge_core/transports/link.py': {ANY: 8, UNREAD: 1, PROCESSES: 3, ABSTRACT: 3, AGAIN: 2},
    'bridge_core/transports/opener.py': {AGAIN: 1},
    'bridge_core/transports/process.py': {ANY: 11, AGAIN: 3, MOMENT: 1, FALSY: 3, IMPLIED: 2},
    'bridge_core/transports/wire.py': {AGAIN: 3, UNREAD: 4, IMPLIED: 3, FALSY: 1},
    'bridge_core/transports/wire_process.py': {
        ANY: 7,
        AGAIN: 7,
        UNREAD: 2,
        FALSY: 2,
        PROCESSES: 1,
    },
    'esi_drive_bridge/protocol.py': {ANY: 3},
    'esi_drive_bridge/session/group.py': {AGAIN: 2, MOMENT: 1, UNREAD: 8},
    'esi_drive_bridge/session/ramp.py': {UNREAD: 2, SAME: 1},
    'esi_drive_bridge/session/session.py': {UNREAD: 4, IMPLIED: 1, FALSY: 2},
    'fort_vsc_bridge/convert.py': {SAME: 1, ANY: 2, IMPLIED: 1},
    'fort_vsc_bridge/protocol/can.py': {IMPLIED: 1, ANY: 14, UNREAD: 4},
    'fort_vsc_bridge/protocol/frames.py': {IMPLIED: 7},
    'fort_vsc_bridge/protocol/hid.py': {ANY: 2},
    'fort_vsc_bridge/protocol/serial.py': {AGAIN: 2, ANY: 4},
    'fort_vsc_bridge/protocol/values.py': {ANY: 1},
    'fort_vsc_bridge/protocol/wires.py': {IMPLIED: 1, UNREAD: 1, ABSTRACT: 2},
    'fort_vsc_bridge/session/device.py': {UNREAD: 6, FALSY: 2, ANY: 1},
    'fort_vsc_bridge/session/line_age.py': {SAME: 3, UNREAD: 1},
    'fort_vsc_bridge/session/session.py': {UNREAD: 6, IMPLIED: 1, AGAIN: 7},
    'fort_vsc_bridge/session/software_stop.py': {UNREAD: 4, AGAIN: 1, FALSY: 1},
    'fort_vsc_bridge/session/stops.py': {UNREAD: 4},
    'io_bridge/modbus.py': {ANY: 4, SAME: 2, AGAIN: 1},
    'io_bridge/session/outputs.py': {UNREAD: 1},
    'io_bridge/session/session.py': {SAME: 1, MOMENT: 1, AGAIN: 1, IMPLIED: 1},
    'io_bridge/session/settings.py': {PROCESSES: 1},
    'rugged_teleop/ledger/book.py': {ANY: 9, AGAIN: 3, FALSY: 1, SAME: 1},
    'rugged_teleop/ledger/stopping.py': {ANY: 2, MOMENT: 9, IMPLIED: 3, SAME: 2},
    'rugged_teleop/ledger/tried.py': {FALSY: 1},
    'safety_mux/arbiter.py': {UNREAD: 10, IMPLIED: 6},
    'safety_mux/button.py': {UNREAD: 3},
    'safety_mux/commissioned.py': {ANY: 1},
    'safety_mux/feedback.py': {UNREAD: 2},
    'safety_mux/inputs.py': {ABSTRACT: 1, IMPLIED: 1, UNREAD: 3},
    'safety_mux/limits.py': {SAME: 14},
    'safety_mux/mapping.py': {SAME: 4},
    'safety_mux/soft_ends.py': {SAME: 3, MOMENT: 3},
    'safety_mux/outputs.py': {UNREAD: 2, IMPLIED: 1},
    'safety_mux/owners.py': {ABSTRACT: 2, UNREAD: 10, IMPLIED: 4},
    'safety_mux/proofs.py': {ANY: 2, UNREAD: 1, AGAIN: 3, FALSY: 1, IMPLIED: 2, MOMENT: 1},
    'safety_mux/protocol.py': {UNREAD: 1, IMPLIED: 1},
    'safety_mux/resets.py': {IMPLIED: 1, FALSY: 2},
    'safety_mux/stops.py': {IMPLIED: 1},
    'ssc_bridge/channels.py': {SAME: 1},
    'ssc_bridge/convert.py': {SAME: 1, IMPLIED: 1},
    'ssc_bridge/protocol/messages.py': {IMPLIED: 1},
    'ssc_bridge/protocol/values.py': {IMPLIED: 1},
    'ssc_bridge/session/auxiliary.py': {UNREAD: 3, IMPLIED: 4, ANY: 1},
    'ssc_bridge/session/outputs.py': {ANY: 1, UNREAD: 8},
    'ssc_bridge/session/polling.py': {UNREAD: 1},
    'ssc_bridge/session/session.py': {UNREAD: 5, AGAIN: 1, IMPLIED: 4},
    'ssc_bridge/session/settings.py': {IMPLIED: 1},
    'ssc_bridge/session/sticks.py': {IMPLIED: 3},
    'vm110_bridge/convert.py': {SAME: 1},
    'vm110_bridge/protocol/frames.py': {IMPLIED: 1, ABSTRACT: 2},
    'vm110_bridge/protocol/messages.py': {IMPLIED: 2, ANY: 1},
    'vm110_bridge/session/controls.py': {IMPLIED: 1},
    'vm110_bridge/session/encoder.py': {UNREAD: 4, SAME: 1},
    'vm110_bridge/session/outbox.py': {IMPLIED: 1},
    'vm110_bridge/session/serials.py': {ANY: 6, FALSY: 2, UNREAD: 15},
    'vm110_bridge/session/session.py': {UNREAD: 5, AGAIN: 5, IMPLIED: 1},
    'vm110_bridge/session/stops.py': {UNREAD: 7, ANY: 2},
}
