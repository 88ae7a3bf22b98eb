"""Pure functions turned into machine code; the only place that knows numba."""
