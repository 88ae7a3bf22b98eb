"""Which controller made a log, and which experiment would settle the open questions."""
