"""Monitors of the Akron Brass 6000 series and their joysticks on CAN."""
