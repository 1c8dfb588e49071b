"""What a user can cause and mend: commands turn it into one sentence and exit status 2."""


class DataError(Exception):
    """A file, folder, table or setting is not what it should be; the message says what to do."""

    @property
    def sentence(self) -> str:
        """The message alone; a loader process wraps its whole traceback round it."""
        return str(self).rsplit(f"{type(self).__name__}: ", 1)[-1].strip()
