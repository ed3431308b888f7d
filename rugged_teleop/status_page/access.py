# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Who may see and use the page, without cookies; and which recordings may be downloaded."""

from __future__ import annotations

from collections.abc import Iterable
import hmac
import ipaddress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit


class Access:
    """
    Judges the headers and the token of a request.

    :param host: IP address that the page is served at; beyond loopback, seeing needs the token.
    :param names: by which it is reached, besides localhost and IP addresses.
    :param token: what a user has to show.
    :param control: whether anybody may control anything.
    """

    def __init__(self, host: str, names: Iterable[str], token: str, *, control: bool) -> None:
        self._names = {'localhost', *(name.lower() for name in names if name)}
        self._token = token.encode()
        self._is_open = ipaddress.ip_address(host).is_loopback
        self.control = control

    @property
    def needs_token(self) -> bool:
        """Whether there is something that only the token opens."""
        return self.control or not self._is_open

    def knows(self, host: str) -> bool:
        """
        Tell whether a Host header is an address or a known name.

        A foreign site that has its own name resolve to this machine comes with that name.
        """
        try:
            name = urlsplit(f'//{host}').hostname or ''
            return name in self._names or bool(ipaddress.ip_address(name))
        except ValueError:
            return False

    def same_origin(self, origin: str | None, host: str) -> bool:
        """Tell whether a request comes from the page itself. Browsers always send the origin."""
        own = [f'{scheme}://{host}'.lower() for scheme in ('http', 'https')]
        return origin is not None and origin.lower() in own

    def may_see(self, token: str) -> bool:
        """Tell whether who shows this token may see the machine's state and its recordings."""
        return self._is_open or self._is_token(token)

    def may_control(self, token: str) -> bool:
        """Tell whether who shows this token may reset, trip and select autonomy."""
        return self.control and self._is_token(token)

    def _is_token(self, token: str) -> bool:
        return hmac.compare_digest(self._token, token.encode(errors='replace'))


_MOST = 100


def recordings(folder: Path | None) -> list[dict[str, Any]]:
    """Return name and size (bytes) of the recordings; the last names, the newest, come first."""
    if folder is None:
        return []
    try:
        files = [path for path in folder.glob('*.mcap') if _is_plain(path)]
        files = sorted(files, key=lambda path: path.name, reverse=True)[:_MOST]
        return [{'name': path.name, 'size': path.stat().st_size} for path in files]
    except OSError:  # a folder that is gone, a file that is being removed
        return []


def recording(folder: Path | None, name: str) -> Path | None:
    """Return the file of a recording; None where the folder itself has none of this name."""
    if folder is None or Path(name).name != name or Path(name).suffix != '.mcap':
        return None
    path = folder / name
    return path if _is_plain(path) else None


def _is_plain(path: Path) -> bool:
    """Tell whether it is a file, and no link that leads elsewhere."""
    return path.is_file() and not path.is_symlink()
