"""The bridge of the Microbotics SSC: RC receiver as operator, servos as actuators."""
