"""Tables on disk, read, followed and laid out as arrays."""
