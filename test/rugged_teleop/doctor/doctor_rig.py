# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The doctor in the test's own process."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import json
from pathlib import Path
from typing import Any

import pytest

from bridge_core.checksums import fletcher16
from rugged_teleop.doctor.configuration import Configured, configured
from rugged_teleop.doctor.findings import Finding
from rugged_teleop.doctor.main import main
from stage.rig import wait_for


def kinds(findings: Iterable[Finding]) -> list[str]:
    return [each.kind for each in findings]


class Visit:
    """What the doctor says. :param arguments: of the command, beside ``--json``."""

    def __init__(self, capsys: pytest.CaptureFixture[str], *arguments: object) -> None:
        with pytest.raises(SystemExit) as caught:
            main(['--json', *map(str, arguments)])
        self.status = caught.value.code
        self.findings: list[dict[str, Any]] = json.loads(capsys.readouterr().out)

    @property
    def kinds(self) -> list[str]:
        return [each['kind'] for each in self.findings]

    def of(self, kind: str) -> dict[str, Any]:
        """Return the one finding of this kind."""
        (found,) = (each for each in self.findings if each['kind'] == kind)
        return found


def parameter_file(folder: Path, **nodes: dict[str, Any]) -> Path:
    """Write a file with these nodes' parameters."""
    sections = {f'/**/{name}': {'ros__parameters': values} for name, values in nodes.items()}
    path = folder / 'my.yaml'
    path.write_text(json.dumps(sections))  # which is YAML
    return path


def node(folder: Path, name: str, **values: Any) -> Configured:
    """Return a node with these parameters, which have to be good."""
    (found,), _ = configured([parameter_file(folder, **{name: values})])
    return found


def found_by(look: Callable[[], Iterable[Finding]], kind: str, text: str = '') -> list[Finding]:
    """
    Look until there is a finding of this kind with this text, and return all of that time.

    A device, or this process, that was held up is heard in part.
    """
    found: list[Finding] = []

    def is_found() -> bool:
        found[:] = look()
        return any(each.kind == kind and text in each.text for each in found)

    wait_for(is_found, 30.0, lambda: f'{kind} {text}: {found}')
    return found


def noise(data: bytes) -> bytes:
    """Return what a line at another baud makes of it."""
    return bytes(byte * 7 + 3 & 0xFF for byte in data)


def counted(offset: int) -> bytes:
    """Return status and pulse inputs of an SSC whose byte count is not that of the payload."""
    packets = []
    for kind, payload in ((10, bytes(2)), (13, bytes(16))):
        body = bytes((kind, len(payload) + offset)) + payload
        packets.append(b'\x81\xa1' + body + fletcher16(body).to_bytes(2, 'little'))
    return b''.join(packets)
