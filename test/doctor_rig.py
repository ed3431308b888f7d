"""The doctor in the test's own process."""

from __future__ import annotations

from collections.abc import Iterable
import json
from pathlib import Path
from typing import Any

import pytest

from rugged_teleop.doctor.configuration import Configured
from rugged_teleop.doctor.configuration import configured
from rugged_teleop.doctor.findings import Finding
from rugged_teleop.doctor.main import main


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
