# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A share of a core, by the files of either version of cgroups."""

from __future__ import annotations

from pathlib import Path

import pytest

from assurance import small_computer
from assurance.benchmarks.rig import UnavailableError
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


def test_what_is_missing_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(UnavailableError, match='no cgroup of processors is mounted'):
        Quota(0.25, [tmp_path])
    (tmp_path / 'cgroup.procs').touch()
    monkeypatch.setattr(Path, 'mkdir', lambda _: (_ for _ in ()).throw(PermissionError('denied')))
    with pytest.raises(UnavailableError, match='denied: be root'):
        Quota(0.25, [tmp_path])
    monkeypatch.setattr(small_computer, 'use_own_domain', lambda **_: None)
    monkeypatch.setattr(Quota.__init__, '__defaults__', ((),))
    assert small_computer.main(['--minutes', '0']) == 2
    assert 'no cgroup' in capsys.readouterr().err
