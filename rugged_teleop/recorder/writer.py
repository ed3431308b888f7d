# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Recordings as MCAP files, written in a thread of their own: a slow or full disk delays nobody.

Needs the package ``mcap``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import os
from pathlib import Path
import queue
import struct
import threading
import time
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC, Writer

from bridge_core import clock
from rugged_teleop.recorder.folder import file_name, Folder, PARAMETERS_OF, UNFINISHED
from rugged_teleop.recorder.ring import Heard

_NICE = 10  # of the thread: whoever decides comes first
_CHUNK = 1 << 16  # bytes
_RECORD = struct.Struct('<BQ')  # opcode and length, before each record of an MCAP file
_WAITING = 600  # batches that a slow disk may leave waiting
Parameters = Mapping[str, Mapping[str, str]]  # by node and name, as JSON


class RecordingFile:
    """
    One MCAP file. :param path: its name when it is finished.

    :raises OSError: as all of its methods do; the file is to be closed then.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(0o750, parents=True, exist_ok=True)
        self.path = path
        self._part = path.with_name(path.name + UNFINISHED)
        new = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        self._file: BinaryIO = os.fdopen(os.open(self._part, new, 0o640), 'wb')
        self._writer = Writer(self._file, chunk_size=_CHUNK)
        self._writer.start(profile='ros2', library='rugged_teleop')
        self._nodes: set[str] = set()  # whose parameters it has
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._epoch = time.time() - clock.now()  # once a file: a clock that steps spoils no ages

    def add_parameters(self, parameters: Parameters) -> None:
        """Add those of the nodes that it has none of."""
        for node in sorted(parameters.keys() - self._nodes):
            self._writer.add_metadata(PARAMETERS_OF + node, dict(parameters[node]))
            self._nodes.add(node)

    def add_reason(self, reason: str) -> None:
        """Add what it was begun for."""
        self._writer.add_metadata('recording', {'reason': reason})

    def write(self, messages: Sequence[Heard]) -> None:
        """Add messages."""
        for heard in messages:
            self._writer.add_message(
                self._channel(heard),
                log_time=self._time(heard.at),
                data=heard.data,
                publish_time=self._time(heard.sent_at),
            )

    def _time(self, at: float) -> int:
        return int((at + self._epoch) * 1e9)

    def _channel(self, heard: Heard) -> int:
        topic, kind, definition, _ = heard.channel
        if topic not in self._channels:
            if kind not in self._schemas:
                self._schemas[kind] = self._writer.register_schema(
                    name=kind, encoding='ros2msg', data=definition.encode()
                )
            self._channels[topic] = self._writer.register_channel(
                topic=topic, message_encoding='cdr', schema_id=self._schemas[kind]
            )
        return self._channels[topic]

    def flush(self) -> None:
        """Have on the disk what was added."""
        # A chunk that is not full yet would stay in memory, and mcap has no public way to end it.
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined]
        self._file.flush()
        os.fsync(self._file.fileno())

    def finish(self, path: Path) -> None:
        """Complete the file, under this name."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self.flush()
        self._file.close()
        self._part.rename(path)
        self.path = path

    def close(self) -> None:
        """Leave it unfinished, and not at all where nothing can be read of it. Raises nothing."""
        with suppress(OSError):
            self._file.close()
        with suppress(OSError):  # it has its name
            if not _has_chunk(self._part):
                self._part.unlink()


def _has_chunk(path: Path) -> bool:
    """Tell whether a whole chunk of messages is in an MCAP file. :raises OSError: it is gone."""
    with path.open('rb') as file:
        size, place = os.fstat(file.fileno()).st_size, file.seek(len(MCAP0_MAGIC))
        while len(head := file.read(_RECORD.size)) == _RECORD.size:
            kind, length = _RECORD.unpack(head)
            place = file.seek(place + _RECORD.size + length)
            if kind == Opcode.CHUNK and place <= size:
                return True
    return False


class FileWriter:
    """
    The thread. Its methods may be called in other threads, and do not wait but where they say so.

    :param said: is called in this thread with a line for the log, and whether it is good.
    """

    def __init__(self, folder: Folder, said: Callable[[str, bool], None]) -> None:
        self.dropped = 0  # messages that the disk was too slow for
        self.error = ''  # of the last recording
        self.last = ''  # path of the last one that is complete
        self.count = self.size = 0  # recordings in the folder, and their bytes
        self._folder = folder
        self._said = said
        self._jobs = queue.SimpleQueue[tuple[Callable[..., None], tuple[Any, ...]]]()
        self._file: RecordingFile | None = None
        self._is_kept = False  # it is to be
        self._ended = False
        self._thread = threading.Thread(target=self._run, name='recorder files', daemon=True)
        self._thread.start()

    def begin(self, reason: str, parameters: Parameters, messages: Sequence[Heard]) -> str:
        """Begin a file with these messages; return its name, as far as it is known."""
        name = file_name(time.time(), reason)
        self.error = ''
        self._put(len(messages), self._begin, name, parameters, messages)
        return name

    def add(self, messages: Sequence[Heard]) -> None:
        """Add messages to the file."""
        self._put(len(messages), self._add, messages)

    def finish(self, reason: str, parameters: Parameters) -> None:
        """
        Complete the file, with the reason as it is known by now in its name.

        :param parameters: as known by now, too: nodes that had just started may have answered.
        """
        self._put(0, self._end, reason, parameters)

    def keep(self, answered: Callable[[str], None]) -> None:
        """Keep the newest recording for ever, or the open one. :param answered: gets its name."""
        self._put(0, self._keep, answered)

    def wait(self, timeout: float) -> bool:
        """Wait until all that it was told is done, and return whether it is."""
        done = threading.Event()
        self._put(0, done.set)
        return done.wait(timeout)

    def stop(self, timeout: float) -> None:
        """Have the jobs done and the thread end; wait up to ``timeout`` s."""
        self._ended = True
        self._put(0, lambda: None)
        self._thread.join(timeout)

    def _put(self, messages: int, job: Callable[..., None], *arguments: Any) -> None:
        if messages and self._jobs.qsize() >= _WAITING:
            self.dropped += messages
        else:  # what completes a file is never left out
            self._jobs.put((job, arguments))

    def _run(self) -> None:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        self._guarded(self._look)
        while not (self._ended and self._jobs.empty()):
            job, arguments = self._jobs.get()
            self._guarded(job, *arguments)

    def _guarded(self, job: Callable[..., None], *arguments: Any) -> None:
        try:
            job(*arguments)
        except Exception as error:  # whatever it is, the next recording may succeed
            text = error.strerror if isinstance(error, OSError) else repr(error)
            self.error = f'{text}: {self._folder.path}'
            self._said(f'no recording: {self.error}', False)
            if self._file is not None:
                self._file.close()
                self._file = None

    def _begin(self, name: str, parameters: Parameters, messages: Sequence[Heard]) -> None:
        self.error = ''
        self._file = RecordingFile(self._folder.path / name)
        self._file.add_parameters(parameters)
        self._file.write(messages)
        self._file.flush()  # whatever becomes of this computer in the next seconds

    def _add(self, messages: Sequence[Heard]) -> None:
        if self._file is not None:
            self._file.write(messages)
            self._file.flush()

    def _keep(self, answered: Callable[[str], None]) -> None:
        newest = [*self._folder.recordings()[-1:]]
        if self._file is not None:
            self._is_kept = True
            answered(self._file.path.name)
        elif newest:
            answered(newest[0].name)
            self._kept(newest[0])

    def _kept(self, path: Path) -> None:
        self._is_kept = False
        self.last = str(self._folder.keep(path))
        self._said(f'kept for ever: {self.last}', True)

    def _end(self, reason: str, parameters: Parameters) -> None:
        file, self._file = self._file, None
        if file is None:
            return
        moment, _, _ = file.path.name.partition('_')
        name = file_name(0.0, reason).partition('_')[2]
        try:
            file.add_parameters(parameters)
            file.add_reason(reason)
            file.finish(file.path.with_name(f'{moment}_{name}'))
        finally:
            file.close()
        self.last = str(file.path)
        self._said(f'recorded {file.path}', True)
        if self._is_kept:
            self._kept(file.path)
        self._look(file.path)

    def _look(self, written: Path | None = None) -> None:
        for path in self._folder.make_room(written):
            self._said(f'removed {path}: the folder is full', True)
        recordings = self._folder.recordings()
        self.count = len(recordings)
        self.size = sum(path.stat().st_size for path in recordings)
