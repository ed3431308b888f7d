# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page on the trial lists the faults that tests plant, by their names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import re
from typing import Any

from stage.rig import ROOT
from test.rugged_teleop.commission import (
    test_commission_actuators,
    test_commission_faults,
    test_commission_features,
    test_commission_remotes,
)

FILES = (
    test_commission_actuators,
    test_commission_faults,
    test_commission_features,
    test_commission_remotes,
)


def _names(faults: Mapping[Any, Any]) -> Iterator[str]:
    """Yield the names of faults, by machine or not."""
    for name, each in faults.items():
        yield from _names(each) if isinstance(each, dict) else [name]


def test_page_lists_every_planted_fault() -> None:
    page = (ROOT / 'docs/commissioning.md').read_text(encoding='utf-8')
    listed = re.findall(r'^\d+\. (.+)$', page, re.MULTILINE)
    planted = [name for each in FILES for name in _names(each.FAULTS)]
    assert sorted(listed) == sorted(planted)
