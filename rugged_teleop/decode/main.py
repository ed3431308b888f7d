# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Show what a capture says: raw bytes, hex, candump, python-can's logs, pcap, pcapng, recordings.

Format and protocol are told by what stands in the file. What is damaged is reported by its offset
in the file, and skipped. The statistics come last, on standard error unless they are all that is
asked for.

Exit status: 0 all was read; 1 something was damaged, or nothing is of a protocol known here; 2
wrong arguments, or a file that cannot be read, or no picture.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import sys

from bridge_core.options import whole_within
from rugged_teleop.command_line import is_of_output, Parser, reason_of
from rugged_teleop.decode.captures import FORMATS, opened
from rugged_teleop.decode.plot import Picture
from rugged_teleop.decode.protocols import entries_of, PROTOCOLS
from rugged_teleop.decode.statistics import Statistics
from rugged_teleop.decode.writers import WRITERS

_EXAMPLES = """\
examples:
  {prog} vsc.bin                            # the bytes of a serial port
  {prog} --as statistics can0.log           # candump -l can0
  {prog} --as csv vm110.pcap > vm110.csv    # tcpdump -i eth0 -w vm110.pcap udp
  {prog} --as json can0.log | jq 'select(.message == "heartbeat") | .fields'
  {prog} --as statistics --plot stop.png 20261122T190455.323Z_stop.mcap
  candump -t a can0 | {prog} -
"""
_BITRATE = 250000  # of Akron's units, and of the VSC as delivered


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    add = result.add_argument
    add('files', nargs='+', metavar='FILE', help='a capture; -: standard input')
    add('--format', choices=FORMATS, default='', help='default: by its beginning')
    add('--protocol', choices=PROTOCOLS, default='', help='default: by its content')
    add('--as', dest='output', choices=WRITERS, default='table', help='default: table')
    add('--plot', metavar='OUT.png', help='also a picture: sticks, stops, commands over time')
    add(
        '--bitrate',
        type=whole_within(1000, 1_000_000),
        default=_BITRATE,
        help='of a CAN bus in bit/s, for its load (250000)',
    )
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop decode') -> None:
    """Decode files; the command's entry point."""
    sys.exit(_decode(parser(prog).parse_mixed(arguments), prog))


def _decode(options: argparse.Namespace, prog: str) -> int:
    try:
        picture = Picture() if options.plot else None
    except ImportError as error:
        print(f'{prog}: {error}', file=sys.stderr)
        return 2
    write = WRITERS[options.output](sys.stdout)
    report = sys.stdout if options.output == 'statistics' else sys.stderr
    status = 0
    for name in options.files:
        statistics = Statistics(options.bitrate)
        try:
            with opened(name, options.format) as capture:
                for entry in entries_of(capture, options.protocol):
                    statistics.note(entry)
                    if picture is not None:
                        picture.add(entry)
                    write(capture.name, entry)
        except (OSError, ValueError) as error:
            if is_of_output(error):
                raise
            print(f'{prog}: {name}: {reason_of(error)}', file=sys.stderr)
            status = 2
            continue
        sys.stdout.flush()  # what was found, then the report
        for line in statistics.lines():
            print(line if report is sys.stdout else f'# {line}', file=report)
        if statistics.damaged or not statistics.decoded:
            status = max(status, 1)
    try:
        if picture is not None:
            picture.save(options.plot)
    except (OSError, ValueError) as error:
        print(f'{prog}: {options.plot}: {reason_of(error)}', file=sys.stderr)
        status = 2
    return status
