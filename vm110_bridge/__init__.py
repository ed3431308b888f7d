"""The VisionRemote VM-110: a base unit (BU) and its remote units (RU), by UDP EG-Link."""
