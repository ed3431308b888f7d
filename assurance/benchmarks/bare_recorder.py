# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recorder that neither writes a ledger nor judges what it hears; ``bench_beside`` runs it."""

from __future__ import annotations

import sys
from typing import Any

from bridge_core.runner import run
from rugged_teleop.ledger.witness import Witness
from rugged_teleop.ledger.writer import LedgerWriter
from rugged_teleop.recorder.node import Recorder


class BareRecorder(Recorder):
    """Records as ever; its ledger has one line."""

    def _make_ledger(self) -> tuple[LedgerWriter, Witness]:
        ledger, witness = super()._make_ledger()
        for owner, names in ((ledger, ('note',)), (witness, ('hear', 'know', 'look'))):
            for name in names:
                setattr(owner, name, _nothing)
        return ledger, witness


def _nothing(*arguments: Any, **further: Any) -> None:
    del arguments, further


def main() -> None:
    raise SystemExit(run([BareRecorder], sys.argv, last=True))


if __name__ == '__main__':
    main()
