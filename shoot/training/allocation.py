"""Memory that was freed is kept: getting it anew from the kernel costs more than many layers do."""

import ctypes
import platform

# Of glibc's mallopt(3).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_NEVER = 2**31 - 1
_LARGEST_BLOCK = 2**30


def keep_freed_memory() -> bool:
    """Let this process keep freed memory for its next tensors; True if it can be told so.

    By default glibc asks the kernel for every large tensor and hands it back when it is freed, and
    the kernel zeroes it page by page each time. A step on a CPU frees and takes gigabytes. The
    process then holds the memory of its largest step until it ends.
    """
    if platform.libc_ver()[0] != "glibc":
        return False
    libc = ctypes.CDLL(None)
    large = bool(libc.mallopt(_M_MMAP_THRESHOLD, _LARGEST_BLOCK))
    return bool(libc.mallopt(_M_TRIM_THRESHOLD, _NEVER)) and large
