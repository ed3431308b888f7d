# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Times for people: local, with the zone."""

from datetime import datetime


def moment(at: float) -> str:
    """Return date and time. :param at: seconds since 1970."""
    return datetime.fromtimestamp(at).astimezone().isoformat(' ', 'milliseconds')


def time_of_day(at: float) -> str:
    """Return the time. :param at: seconds since 1970."""
    return moment(at).partition(' ')[2]
