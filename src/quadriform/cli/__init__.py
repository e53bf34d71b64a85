"""The terminal: one verb a file, no mathematics. stdout carries data, stderr progress and warnings."""
