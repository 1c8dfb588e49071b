"""From data and templates to a run folder: settings, data, loop, and all that a run leaves."""
