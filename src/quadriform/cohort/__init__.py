"""Many subjects, one table: units of work a subject, standard stores, and statistics of shape."""
