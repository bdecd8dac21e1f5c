"""What the commands do: imported once a command line is understood, because it takes seconds to import."""
