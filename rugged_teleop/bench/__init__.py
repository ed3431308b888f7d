"""One joint of one drive, for a bounded time, without a mux."""
