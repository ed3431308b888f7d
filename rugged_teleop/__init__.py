"""The commands around the nodes: the stack in one process, the simulated devices."""
