"""Images and sweeps: read, turned into what networks take, and looked at for damage."""
