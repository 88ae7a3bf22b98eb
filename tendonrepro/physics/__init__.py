"""The paper's equations as pure functions: no files, no clock, no state."""
