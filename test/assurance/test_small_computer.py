# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A share of a core, by the files of either version of cgroups."""

from __future__ import annotations

from pathlib import Path

import pytest

from assurance.small_computer import Quota

# By version: what the kernel has made in the folder, and what is then to be in it.
VERSIONS = {
    '1': ('cpu.cfs_quota_us', {'cpu.cfs_period_us': '10000', 'cpu.cfs_quota_us': '2500'}),
    '2': ('cpu.max', {'cpu.max': '2500 10000'}),
}


@pytest.mark.parametrize(('known_by', 'written'), VERSIONS.values(), ids=VERSIONS)
def test_share_is_of_one_core_in_slices_and_holds_for_what_is_put_in(
    tmp_path: Path, known_by: str, written: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'cgroup.procs').touch()
    make = Path.mkdir

    def mkdir(folder: Path) -> None:
        make(folder)
        (folder / known_by).touch()
        (folder / 'cpu.stat').write_text('nr_throttled 2\nthrottled_time 1500000000\n')

    monkeypatch.setattr(Path, 'mkdir', mkdir)
    with Quota(0.25, [tmp_path / 'none', tmp_path]) as quota:
        (folder,) = tmp_path.glob('rugged_teleop_*')
        assert {name: (folder / name).read_text() for name in written} == written
        quota.take([17])
        assert (folder / 'cgroup.procs').read_text() == '17'
        assert quota.throttled() == 1.5
