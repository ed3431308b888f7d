# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Have rosbags read recordings: ``pip install rosbags``, then run this file.

``python assurance/peers/rosbags_reads.py test/recordings/lost_remote.mcap``. Status 1 where it
cannot read one of them, or a message in it.
"""

from collections import Counter
from pathlib import Path
import sys

from rosbags.highlevel import AnyReader, AnyReaderError

status = 0
for name in sys.argv[1:]:
    counts: Counter[str] = Counter()
    try:
        with AnyReader([Path(name)]) as reader:
            for connection, _, raw in reader.messages():
                reader.deserialize(raw, connection.msgtype)
                counts[connection.topic] += 1
        print(f'{name}: {counts.total()} messages of {len(counts)} topics')
    except AnyReaderError as error:
        status = 1
        print(f'{name}: {error}, after {counts.total()} messages')
sys.exit(status)
