"""What every command shares: how a function becomes one, how a study runs, and what it gives."""
