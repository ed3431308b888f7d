# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the remote shows of the mux: four lines that CAN carries, too (manual 6.5, 8.2.8).

The mux's state, then a text by the reason's code: what it is, and the first steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from bridge_core.reasons import by_code, Coded, from_values, NAMES

WIDTH = 18  # characters; serial has 20
LINES = 4
_MOST = 1000  # characters of a value that are read; a wire takes no more than it can send


@dataclass(frozen=True, slots=True)
class MuxStatus:
    """
    What a remote needs of the mux's ``~/status``.

    :param state: such as STOPPED. :param code: of the most urgent reason; empty: there is none.
    :param about: whom the reason names, unless that is this remote; empty: nobody.
    :param owner: who else has control; empty: nobody, or this remote. :param drives: this has.
    :param refused: how often its deadman was pressed and gave no control.
    """

    state: str
    code: str = ''
    about: str = ''
    owner: str = ''
    drives: bool = False
    refused: int = 0

    @property
    def stops(self) -> bool:
        """Whether the machine stops, or was stopped."""
        return self.state.startswith('STOP')


def status_from(values: Mapping[str, str], joy: str) -> MuxStatus:
    """
    Read the values of a ``~/status``.

    A reason that names another operator gives way to one of the same code that names this.

    :param joy: the full name of this remote's ``~/joy``.
    """
    values = {key: text[:_MOST] for key, text in values.items()}
    own = {key.removeprefix('joy of ') for key, topic in values.items() if topic == joy}
    code = values.get('code', '')
    alike = [each for each in from_values(values) if isinstance(each, Coded) and each.code == code]
    alike.sort(key=lambda each: each.fields.get('operator', '') not in own)
    named = (alike[0].fields[name] for name in NAMES if alike and name in alike[0].fields)
    about, owner = next(named, ''), values.get('owner', 'none')
    return MuxStatus(
        state=values.get('state', ''),
        code=code or ('slowed' if 'slowed' in values else ''),
        about='' if about in own else about,
        owner='' if owner in own | {'none'} else owner,
        drives=owner in own,
        refused=sum(_count(values.get(f'deadman of {name} refused', '')) for name in own),
    )


def _count(text: str) -> int:
    return int(text) if text.isdecimal() and len(text) < 10 else 0  # of a foreign mux


def lines_of(status: MuxStatus | None) -> tuple[str, ...]:
    """Return the four lines. None: nothing is heard of the mux."""
    if status is None:
        return _four('NO NEWS OF THE MUX', _texts(_UNHEARD, ''))
    return _four(f'{status.state} {status.owner}'.strip(), _texts(status.code, status.about))


def _four(*texts: str | tuple[str, ...]) -> tuple[str, ...]:
    head, rest = texts
    found = [_printable(each[:WIDTH]) for each in (head, *rest) if each][:LINES]
    return (*found, *[''] * (LINES - len(found)))


def _texts(code: str, about: str) -> tuple[str, ...]:
    """Return the text of the code, or of its family; a code without one shows itself."""
    family = code
    while family and family not in TEXTS:
        family = family.rpartition('.')[0]
    text = TEXTS.get(family, (code, _CALL) if code else ())
    return tuple(about if each == '{}' else each for each in text)


def _printable(text: str) -> str:
    return ''.join(each if each.isascii() and each.isprintable() else '?' for each in text)


_UNHEARD = 'unheard'
_CALL = 'Call technician'
_TABLE = """
unheard: Do not drive | Call technician
slowed: Slowed by a limit

fort: FORT fault | Call technician
fort.estop: Stop at the VSC | Call technician
fort.estop.remote: E-stop on remote | Release it | Acknowledge it
fort.estop.wired: Wired e-stop | Release it | Acknowledge it
fort.estop.any: E-stop pressed | Release it | Acknowledge it
fort.estop.asked: Computer stops it | End other stops | Acknowledge it
fort.estop.held: Earlier stop held | Acknowledge it
fort.remote.off: Remote is off | Switch it on | Acknowledge it
fort.remote.not_operational: Not Operational | Go to Operational
fort.remote.menu: Remote in its menu | Leave the menu
fort.remote.paused: Remote is paused | Hold it upright | Leave Pause
fort.stick: Control is broken | Have it repaired
fort.battery: Battery is low | Charge the remote
fort.radio: Radio is weak | Come nearer
fort.link.deaf: VSC is deaf | Press wired e-stop

vm110: VM-110 fault | Call technician
vm110.link.silent: VM-110 not heard | Check its power
vm110.bu.stopped: VM-110 e-stop | Release it
vm110.ru.stopped: VM-110 e-stop | Release it
vm110.bu.blocked: VM-110 not armed | Turn on its remote
vm110.bu.initial: VM-110 starts | Wait | Arm its remote
vm110.bu.missed: VM-110 missed us | Rearm its remote
vm110.ru.tilted: VM-110 is tilted | Hold it upright
vm110.ru.inactive: VM-110 is inactive | Enable it again
vm110.battery: VM-110 battery low | Exchange it
vm110.hold: VM-110 stopped too | End other stops

akron: Akron fault | Call technician
akron.link.silent: Akron not heard | Check its power
akron.enable.off: Akron not enabled | Close its switch
akron.foreign: Foreign joystick | Let go of it
akron.soe: Akron not allowed | Let go, move again
akron.motion: Akron moves itself | Stop it there

esi: Drive fault | Call technician
esi.link.silent: Drive not heard | Check its power
esi.clear: Drive keeps errors | Mend the cause | Clear them
esi.disobeys: Drive disobeys | Cut its power
esi.internal_temperature: Drive is hot | Let it cool
esi.motor_temperature: Motor is hot | Let it cool

ssc: SSC fault | Call technician
ssc.link.silent: SSC not heard | Check its power
ssc.output: SSC obeys another | Switch to SERIAL
ssc.command: SSC says stop | Switch its remote

io: I/O box fault | Call technician
io.estop: Contact fault at | {} | Call technician
io.estop.pressed: Stop pressed at | {} | Release it
io.estop.released: Just released: | {} | Wait
io.estop.unread: Not read yet: | {} | Wait
io.link.silent: I/O not heard | Check its power

port: Port is not open | Call technician
port.missing: Device unplugged | Plug it in
port.dead: Device is dead | Plug it in anew
link: Line is damaged | Check its cable
wire: Node restarts | Wait | Call technician
node: Node is inactive | Call technician
input: Input is unsound | Call technician
gate: Drive is held | Call technician
gate.disabled: Drive is disabled | Press the deadman
gate.stopped: Drive is stopped | End other stops
gate.neutral: Not at neutral | Let go of sticks
gate.edge: Deadman was held | Release it | Press it again

recorder: Recorder fault | Call technician

mux: Mux fault | Call technician
mux.stopped: Stopped | Wait
mux.stopping: Ramp to standstill | Wait
mux.reset.due: Ready for a reset | Reset
mux.reset.clearing: Stops just cleared | Wait, then reset
mux.reset.script: Resets are called | Call technician
mux.button.held: Reset is held | Release it
mux.button.quiet: No reset button | Call technician
mux.trip: Tripped | Reset
mux.source: Source is unsound | {} | Call technician
mux.source.silent: Not heard: | {} | Start its node
mux.source.stale: Not heard: | {} | Start its node
mux.source.was_stale: Was not heard: | {} | Reset
mux.source.lost: Messages were lost | Reset
mux.source.stop: Stopped by | {} | Release it there
mux.source.echo: Stopped too: | {} | End other stops
mux.input: News come late: | {} | Check the network
mux.topic: Topic has no node | Start its node
mux.output: A second mux | Call technician
mux.operator.silent: No sticks heard: | {} | Switch it on
mux.operator.stale: No sticks heard: | {} | Switch it on
mux.operator.busy: Not at neutral | {} | Let go of all
mux.operator.invalid: Sticks do not fit | {} | Call technician
mux.operator.same_stamp: Pad may be gone | {} | Switch it on
mux.operator.may_be_gone: Pad may be gone | {} | Look at it
mux.operator.press: Press the deadman | {}
mux.operator.other_buttons: Other buttons held | {} | Press the deadman
mux.operator.early: Pressed too early | {} | Release, wait
mux.operator.unrested: Not at rest yet | {} | Let go of sticks
mux.operator.resting: Not rested yet | {} | Wait
mux.operator.starts: Starts from zero | Wait
mux.standstill: Joints still move | Wait
mux.overruled: Loses control | {} | Let go of all
mux.owner.zero: At zero | {} | Move a stick
mux.owner.axis_button: No axis button | {} | Hold it as well
mux.autonomy: Planner fault | Call technician
mux.autonomy.silent: Planner not heard | Start it
mux.autonomy.stale: Planner not heard | Start it
mux.autonomy.resting: Planner not at 0 | Wait
mux.autonomy.select: Autonomy is free | Select it
mux.motion.unstopped: Joints still move | Stop otherwise
mux.motion.overspeed: Joint runs unasked | {} | Look at brake
mux.limit.slows: Slowed by | {}
mux.limit.end: Near its end: | {} | Move it back
mux.feedback: Joints are unseen | Start drive node
mux.frozen: Mux was frozen | Reset
mux.commissioning: Not commissioned | Call technician
mux.inactive: Mux is inactive | Call technician
mux.commands: No drive listens | Start drive node
mux.joy.held: Held from before | {} | Let go of it
mux.drive.silent: Not heard: | {} | Start its node
mux.drive.stale: Not heard: | {} | Start its node
mux.drive.disabled: Not enabled: | {} | Wait
"""


def _read(table: str) -> dict[str, tuple[str, ...]]:
    rows = (line.split(': ', 1) for line in table.splitlines() if line)
    return by_code((code, tuple(text.split(' | '))) for code, text in rows)


TEXTS: Mapping[str, tuple[str, ...]] = MappingProxyType(_read(_TABLE))
