"""What ``make demo`` shows: simulated devices, the real stack, a live view or a scripted scene."""
