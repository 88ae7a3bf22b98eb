"""From a file of any format to signals, in a process with limits; enter by `guard.read_guarded`."""
