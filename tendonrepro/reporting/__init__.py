"""One HTML file for a reviewer, and the words and tables it shares with findings.md and tables.md of docs."""
