"""Every command as a function; ``import tendonrepro`` has them all."""
