"""ESI Motion servo drives with the safety critical RS422 protocol (Stinger, Nova)."""
