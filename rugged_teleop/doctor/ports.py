# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serial ports and hidraw devices: which there are, who has them, who may open them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
import contextlib
from dataclasses import dataclass
import grp
import os
from pathlib import Path
import re
import stat

from serial.tools import list_ports

from bridge_core.realtime import user_name
from bridge_core.transports.exclusive import PTY_MAJORS
from bridge_core.transports.serial_identity import identity_of
from rugged_teleop.doctor.findings import Finding, finding
from rugged_teleop.reference import NODES

PROC = Path('/proc')
_RULES = tuple(
    Path(folder, '60-rugged-teleop.rules')
    for folder in ('/etc/udev/rules.d', '/run/udev/rules.d', '/usr/lib/udev/rules.d')
)
_BY_RULE = ('/dev/fort_vsc', '/dev/esi_drive', '/dev/ssc')  # the names that the rules give
_BY_ID = Path('/dev/serial/by-id')
_FORT_VENDOR = 0x2A99
_LOCK = re.compile(r'\d+: (?:FLOCK|OFDLCK|POSIX) .* (-?\d+) ([0-9a-f]+):([0-9a-f]+):(\d+) \S+ \S+')
_MEMORY_MAJOR = 1  # /dev/null and the like
_OURS = re.compile(rf'\b({"|".join(("rugged_teleop_stack", *(node.name for node in NODES)))})\b')


@dataclass(frozen=True)
class Holder:
    """A process that has a port. :param command: its command line."""

    pid: int
    command: str

    def __str__(self) -> str:
        return f'{self.command[:60] or "a process"} (pid {self.pid})'

    @property
    def is_ours(self) -> bool:
        """It is a node of this package, or its wire."""
        return _OURS.search(self.command) is not None


@dataclass(frozen=True)
class User:
    """Who runs this. :param groups: numbers that count now; :param entered: those to come."""

    name: str
    uid: int
    groups: Collection[int]
    entered: Collection[int] = ()


@dataclass(frozen=True)
class PortFacts:
    """
    What the file of a port says.

    :param path: as it was given. :param device: what that is in the end; empty: nothing.
    :param mode: its permissions. :param group: name of the group ``gid``.
    :param allowed: the kernel lets this process read and write it, as an access list may say.
    """

    path: str
    device: str = ''
    mode: int = 0
    uid: int = 0
    gid: int = 0
    group: str = ''
    is_port: bool = True
    holders: tuple[Holder, ...] = ()
    allowed: bool = False


def this_user() -> User:
    """Return who runs this."""
    name = user_name()
    entered = [group.gr_gid for group in grp.getgrall() if name in group.gr_mem]
    return User(name, os.geteuid(), {os.getegid(), *os.getgroups()}, entered)


def port_facts(path: str) -> PortFacts:
    """Return what there is at a path; nothing is opened."""
    try:
        status = os.stat(path)
    except OSError:
        return PortFacts(path)
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    device = os.path.realpath(path)
    is_port = stat.S_ISCHR(status.st_mode) and os.major(status.st_rdev) != _MEMORY_MAJOR
    return PortFacts(
        path,
        device,
        stat.S_IMODE(status.st_mode),
        status.st_uid,
        status.st_gid,
        group,
        is_port,
        tuple(holders_of(device, status)) if is_port else (),
        os.access(path, os.R_OK | os.W_OK, effective_ids=True),
    )


def holders_of(device: str, status: os.stat_result, proc: Path = PROC) -> Iterator[Holder]:
    """
    Yield the processes that have a device open, or locked: those of others show only a lock.

    Whoever has the other side of a pty is the device, and holds nothing.
    """
    is_pty = os.major(status.st_rdev) in PTY_MAJORS
    number = None if is_pty else status.st_rdev  # a container numbers its ptys anew
    pids = {*_locks(status, proc), *_open_in(device, proc, number)} - {os.getpid()}
    index = os.minor(status.st_rdev) if is_pty else None
    for pid in sorted(pids):
        if index is None or not _is_master(proc / str(pid), index):
            yield Holder(pid, _command(proc / str(pid)))


def device_of(pty: str) -> Holder | None:
    """Return who has both sides of a pty, as a simulated device does; None: nobody."""
    with contextlib.suppress(OSError):
        index = os.minor(os.stat(pty).st_rdev)
        for pid in sorted({*_open_in(pty, PROC)}):
            if _is_master(PROC / str(pid), index):
                return Holder(pid, _command(PROC / str(pid)))
    return None


def _open_in(device: str, proc: Path, number: int | None = None) -> Iterator[int]:
    """Yield who has it open. :param number: of the device, by whatever node; None: by its path."""
    for link in proc.glob('[0-9]*/fd/*'):
        with contextlib.suppress(OSError):  # it has ended, or is another user's
            path = os.readlink(link)
            is_node = number is not None and path.startswith('/dev/')
            if path == device or (is_node and os.stat(link).st_rdev == number):
                yield int(link.parts[-3])


def _locks(status: os.stat_result, proc: Path) -> Iterator[int]:
    where = (os.major(status.st_dev), os.minor(status.st_dev), status.st_ino)
    with contextlib.suppress(OSError):
        for line in (proc / 'locks').read_text(encoding='ascii').splitlines():
            lock = _LOCK.match(line)
            if lock and (int(lock[2], 16), int(lock[3], 16), int(lock[4])) == where:
                yield int(lock[1])


def _is_master(process: Path, index: int) -> bool:
    for file in process.glob('fdinfo/*'):
        with contextlib.suppress(OSError):
            if re.search(rf'^tty-index:\s*{index}$', file.read_text(encoding='ascii'), re.M):
                return True
    return False


def _command(process: Path) -> str:
    with contextlib.suppress(OSError):
        text = (process / 'cmdline').read_bytes().decode(errors='replace')
        return ' '.join(text.replace('\0', ' ').split())
    return ''


def may_open(facts: PortFacts, user: User, groups: Collection[int]) -> bool:
    """Tell whether a user, in these groups, may read and write a port."""
    if user.uid == 0:
        return True
    if user.uid == facts.uid:
        bits = facts.mode >> 6
    else:
        bits = facts.mode >> 3 if facts.gid in groups else facts.mode
    return bits & 6 == 6


def port_findings(
    facts: PortFacts, user: User, node: str = '', *, rules: Sequence[Path] = _RULES
) -> list[Finding]:
    """
    Return what is wrong with a port before anybody opens it; empty: nothing.

    :param node: whose port it is; empty: of no node.
    """
    words = {'port': facts.path, 'node': node, 'user': user.name}
    if not facts.device:
        ruled = facts.path.startswith(_BY_RULE) and not any(rule.exists() for rule in rules)
        return [finding('rules missing' if ruled else 'port missing', **words)]
    if not facts.is_port:
        return [finding('no port', **words)]
    if not facts.allowed and not may_open(facts, user, user.groups):
        words |= {'group': facts.group, 'mode': f'{facts.mode:o}'}
        if not may_open(facts, user, {facts.gid}):
            return [finding('no group', **words)]
        entered = may_open(facts, user, user.entered)
        return [finding('not logged in again' if entered else 'no permission', **words)]
    ours = [holder for holder in facts.holders if holder.is_ours]
    others = [holder for holder in facts.holders if not holder.is_ours]
    if others:
        return [finding('port in use', holder=', '.join(map(str, others)), **words)]
    return [finding('port of a node', holder=str(ours[0]), **words)] if ours else []


def identity_findings(port: str, node: str = '') -> list[Finding]:
    """Say which device a port's name stands for, and whether it stays so."""
    identity = identity_of(port)
    if not identity.text:
        return []
    words = {'port': port, 'node': node, 'device': identity.text}
    if identity.is_numbered:
        return [finding('port by number', remedy=identity.remedy, **words)]
    return [finding('port identity', **words)]


def unseen_findings(opened: Sequence[str], user: User) -> list[Finding]:
    """Say who may have ports without that it can be seen. :param opened: these."""
    return [finding('users unseen', ports=', '.join(opened))] if opened and user.uid else []


# What is plugged in


@dataclass(frozen=True)
class UsbPort:
    """A port that the computer has. :param links: its names in /dev/serial/by-id."""

    device: str
    text: str
    vendor: int | None = None
    links: tuple[str, ...] = ()


def usb_ports() -> list[UsbPort]:
    """Return the serial ports that are there; the bare ones of a mainboard apart."""
    found = []
    for port in list_ports.comports():
        if port.vid is None:
            continue
        links = (str(link) for link in _BY_ID.glob('*') if link.resolve() == Path(port.device))
        text = f'{port.description} ({port.vid:04x}:{port.pid:04x} {port.serial_number or ""})'
        found.append(UsbPort(port.device, text.replace(' )', ')'), port.vid, tuple(links)))
    return found


def usb_findings(ports: Iterable[UsbPort], *, rules: Sequence[Path] = _RULES) -> Iterator[Finding]:
    """Yield what is plugged in, and what the udev rules would do for it."""
    ruled = any(rule.exists() for rule in rules)
    for port in ports:
        yield finding('usb port', port=port.device, text=port.text, links=', '.join(port.links))
        if port.vendor == _FORT_VENDOR and not ruled:
            yield finding('rules not installed', port=port.device)
