"""The paper's experiment as one HTML file that runs in a browser."""
