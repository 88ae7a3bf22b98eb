"""What would settle the open questions: which controller made a log, and which experiment would tell."""
