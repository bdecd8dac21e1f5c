"""What goes wrong with experience."""


class ExperienceError(ValueError):
    """Experience that cannot be used; the message names the file, the field and what was expected."""
