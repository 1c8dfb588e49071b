"""What a user can cause and mend: commands turn it into one sentence and exit status 2."""

from lss_core.legible import legible

# Texts of data may be of any length; a sentence is one that can be read.
_HEAD, _TAIL = 360, 160


class DataError(Exception):
    """A file, folder, table or setting is not what it should be; the message says what to do."""

    @property
    def sentence(self) -> str:
        """The message alone, fit for a terminal; the middle of a very long one is left out."""
        # A loader process wraps its whole traceback round the message.
        text = str(self).rsplit(f"{type(self).__name__}: ", 1)[-1]
        text = legible(" ".join(text.split()))
        if len(text) <= _HEAD + _TAIL:
            return text
        return f"{text[:_HEAD]} ... {text[-_TAIL:]}"
