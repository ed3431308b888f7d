# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's parameters."""

import ipaddress
from pathlib import Path

from bridge_core.parameters import Parameter


def _check_address(host: str) -> None:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        raise ValueError('allowed is an IP address of this machine, or 0.0.0.0 for all') from None


def _check_folder(path: str) -> None:
    if path and not Path(path).is_dir():
        raise ValueError('allowed is a folder that exists')


PARAMETERS = (
    Parameter(
        'host',
        '127.0.0.1',
        'IP address that it is served at; any but the default needs the token. 0.0.0.0: all.',
        check=_check_address,
    ),
    Parameter(
        'port',
        8080,
        'TCP port that it is served at. 0: any that is free.',
        minimum=0,
        maximum=65535,
    ),
    Parameter(
        'names',
        [''],
        'Names by which browsers reach it, besides localhost and IP addresses. Others are '
        'refused.',
    ),
    Parameter(
        'allow_control',
        False,
        'Offer reset, trip and autonomy on the page, to whoever has the token.',
        fixed=True,
    ),
    Parameter(
        'recordings',
        '',
        'Folder whose files with the ending .mcap are offered for download. Empty: none.',
        check=_check_folder,
    ),
)
