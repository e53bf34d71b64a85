"""The number of threads that share the loops over points; results do not depend on it."""

import os

WORTH = 16384
"""With fewer points than this one thread is as fast as several, which take time to start."""


def threads_for(count: int) -> int:
    """Threads for so many points: one for few, else those of OMP_NUM_THREADS or all cores that this process may use."""
    if count < WORTH:
        return 1
    requested = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    if requested.isdigit() and int(requested) > 0:
        return int(requested)
    return cores()


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
