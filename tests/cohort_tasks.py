"""Tasks that workers import by their names; nothing else, so that a worker starts fast."""

import os
import time


def doubled(task):
    """Twice the task; 4 and 9 end their worker, 7 raises."""
    if task in (4, 9):
        os._exit(1)
    if task == 7:
        raise ValueError("seven")
    return 2 * task


def overlapping(task):
    """The name of the task: "long" ends only if it was begun before; "fatal" ends its worker, but after that."""
    name, begun = task
    if name == "long" and not begun.exists():
        begun.touch()
        time.sleep(1000)
    while not begun.exists():
        time.sleep(0.01)
    if name == "fatal":
        os._exit(1)
    return name
