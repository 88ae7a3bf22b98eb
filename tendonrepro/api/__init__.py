"""Every command as a function; ``import tendonrepro as tr`` has them all."""
