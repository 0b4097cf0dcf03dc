"""Memory that was freed serves again, and does not go back to the system between two frames."""

_LARGEST = 2**25
"""Bytes, with what stands before them, of the largest block that glibc takes note of: see below."""

_HEADER = 2**14
"""More than a page, the most that is added to a block."""


def keep_freed_memory() -> None:
    """Let the C library keep some tens of megabytes.

    Arrays of a frame are a megabyte or so. glibc has the system map such blocks one by one, and each page of
    a new one costs microseconds when it is first touched: a third of a million of them in an animatic of ten
    seconds. It learns better when a large block is freed (`mallopt(3)`, M_MMAP_THRESHOLD): from then on it
    takes blocks of up to that size from its own heap, and keeps twice as much at the end of that. So one is
    freed here, which nobody has touched. Other C libraries have their own ways, and lose nothing.
    """
    bytes(_LARGEST - _HEADER)
