"""One experiment over values of one or two keys."""
