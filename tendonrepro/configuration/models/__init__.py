"""The frozen models of configuration files."""
