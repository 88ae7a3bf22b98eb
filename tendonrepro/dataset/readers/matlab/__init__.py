"""MATLAB files of every age."""
