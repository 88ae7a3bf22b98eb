"""Pure functions turned into machine code, and printed as JavaScript."""
