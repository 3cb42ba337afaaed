"""The one error for wrong input: a sentence that names file, key and reason; the command line turns it into exit 2."""


class InputError(Exception):
    """Wrong input of any kind. `str(error)` is one clear sentence for the person who gave it."""
