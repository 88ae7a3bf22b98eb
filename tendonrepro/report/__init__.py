"""One HTML file for a reviewer, and the words and tables that it shares with docs/findings.md."""
