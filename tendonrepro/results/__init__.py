"""What a run leaves: traces, tables, figures, manifest, folder.

Nothing is imported here: HDF5 and matplotlib would be loaded by whoever asks for the name of a file.
"""
