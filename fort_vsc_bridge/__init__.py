"""The FORT Vehicle Safety Controller (VSC) and its Safe Remote Control (SRC)."""
