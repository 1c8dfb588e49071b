"""The commands: each parses a config, calls one function and reports."""
