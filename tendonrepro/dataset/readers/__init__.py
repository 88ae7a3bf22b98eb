"""From a file of any format to signals, in a process with limits; :mod:`tendonrepro.dataset.readers.read.guard`."""
