"""Notes of results, of which some are warnings that leave the status "ok"."""


def note_of(found, kind):
    """The sentence of a note of this kind; empty without one."""
    return next((note.partition(": ")[2] for note in found.notes if note.startswith(f"{kind}: ")), "")
