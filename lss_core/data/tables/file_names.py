"""Names that tables give to files: none may lead out of the folder it is meant for."""

import re

# Control characters steer terminals, and halves of surrogate pairs cannot be written.
_FORBIDDEN = r"[\x00-\x1f\x7f-\x9f\ud800-\udfff\\]"
_UNSAFE = re.compile(rf"^/|(?:^|/)\.\.(?:/|$)|{_FORBIDDEN}")
_LONGEST = 1024


def leads_astray(name: str) -> bool:
    """Whether a file's name, relative to the data root, is not to be followed.

    That is an absolute one, one with `..` as a folder, with a backslash or a control character, or
    one of more than 1024 characters. Symbolic links on the way are the user's own and followed.
    """
    return _UNSAFE.search(name) is not None or len(name) > _LONGEST


def is_plain(name: str) -> bool:
    """Whether a text can be the name of a file in a given folder, and of nothing else."""
    return (
        name not in ("", ".", "..")
        and "/" not in name
        and not leads_astray(name)
        and len(name.encode()) <= 200
    )
