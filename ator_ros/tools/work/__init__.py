"""The work of the commands, imported only after a command line is parsed, because imports take seconds."""
