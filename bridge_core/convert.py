"""Conversions that all rooms share. Pure."""

import math


def scaled(value: float, full_scale: float, deadband: float = 0.0) -> float:
    """
    Return a control as -1 to 1, clipped, without a step at the edge of the deadband; never -0.0.

    :param full_scale: the magnitude that is 1. :param deadband: 0 to below 1, of full scale.
    """
    magnitude = min(abs(value) / full_scale, 1.0)
    if magnitude <= deadband:
        return 0.0
    return math.copysign((magnitude - deadband) / (1.0 - deadband), value)
