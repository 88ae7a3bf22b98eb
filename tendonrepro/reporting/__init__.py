"""One HTML file for a reviewer, and what it shares with findings.md and tables.md."""
