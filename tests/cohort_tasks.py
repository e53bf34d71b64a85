"""A task that workers import by its name; nothing else, so that a worker starts fast."""

import os


def doubled(task):
    """Twice the task; 4 and 9 end their worker, 7 raises."""
    if task in (4, 9):
        os._exit(1)
    if task == 7:
        raise ValueError("seven")
    return 2 * task
