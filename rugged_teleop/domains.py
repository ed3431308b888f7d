# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS domains that no neighbour on this machine uses, for demos and tests."""

from __future__ import annotations

import os
import socket

from bridge_core.share import loopback_profiles

_DOMAINS = range(1, 102)  # 101 is the last whose ports are clear of the ephemeral ones
FIRST_PORT, PORTS = 7400, 250  # of DDS, and how many each domain has
_UNICAST = 10  # from a domain's first port to that of its first participant's discovery


def claim_domain() -> socket.socket:
    """
    Set a ROS domain that nobody else uses, on this machine only; keep what is returned.

    The claim is an abstract socket name, which the kernel drops with the process however it ends.
    A domain is also left alone when its first DDS port is taken, by whoever knows no claims.

    :raises RuntimeError: all are taken.
    """
    start = os.getpid() % len(_DOMAINS)
    for domain in (*_DOMAINS[start:], *_DOMAINS[:start]):
        claim = _try_domain(domain)
        if claim is not None:
            os.environ['ROS_DOMAIN_ID'] = str(domain)
            _stay_on_this_machine()
            return claim
    raise RuntimeError('no ROS domain from 1 to 101 is free')


def _stay_on_this_machine() -> None:
    os.environ.pop('ROS_STATIC_PEERS', None)
    os.environ.pop('ROS_LOCALHOST_ONLY', None)  # rcl adds shared memory to any profile for it
    if os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp').startswith('rmw_fastrtps'):
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'  # as the profile says
        os.environ |= loopback_profiles()
    else:
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


def _try_domain(domain: int) -> socket.socket | None:
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f'\0rugged_teleop_domain_{domain}')
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(('127.0.0.1', FIRST_PORT + PORTS * domain + _UNICAST))
    except OSError:
        claim.close()
        return None
    return claim
